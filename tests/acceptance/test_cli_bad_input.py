"""Bad photographs and bad flags end in exit code 2, one sentence on stderr, and no folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as PillowImage

Command = Callable[..., Any]


@pytest.fixture
def sound(tmp_path: Path) -> tuple[Path, Path]:
    """A pair that would be read."""
    rng = np.random.default_rng(2)
    paths = (tmp_path / "a.png", tmp_path / "b.png")
    for path, brightness in zip(paths, (1, 2), strict=True):
        codes = (rng.uniform(20, 120, (64, 96, 3)) * brightness).astype(np.uint8)
        PillowImage.fromarray(codes).save(path)
    return paths


def refused(run: Any, *words: str) -> str:
    """The one sentence of a run that was refused."""
    sentence: str = run.stderr
    assert run.code == 2, sentence
    assert run.stdout == ""
    assert sentence.count("\n") == 1
    assert sentence.endswith(".\n")
    assert len(sentence) < 400
    assert "Traceback" not in sentence
    for word in words:
        assert word in sentence
    assert not run.results.folder.exists()
    return sentence


def test_a_bad_pair_is_refused(command: Command, bad_pair: Any) -> None:
    refused(command(bad_pair.files), bad_pair.reason)


def test_a_pair_the_wrong_way_round_is_refused(command: Command, scene: Callable[..., Any]) -> None:
    no_flash, flash = scene(2).dng

    refused(command((flash, no_flash)), "swap the two")


def test_a_missing_file_is_refused(
    command: Command, process: Callable[..., Any], sound: tuple[Path, Path]
) -> None:
    """In a process of its own, as in a fork."""
    pair = sound[0], sound[0].with_name("none.png")

    sentence = refused(command(pair, run=process), "none.png", "no such file")

    assert refused(command(pair)) == sentence


DIRECTIONS = {"lights": [{"direction": [1, 0, 1]}]}
BAD_FLAGS = {
    "--lights 4": (["--lights", "4"], ["more than three lamps"]),
    "--lights 0": (["--lights", "0"], ["lights"]),
    "--lights many": (["--lights", "many"], ["lights"]),
    "--method other": (["--method", "other"], ["method", "best", "paper"]),
    "--basis other": (["--basis", "other"], ["basis", "wpca", "pca", "joint"]),
    "--camera unknown": (["--camera", "Nikon D5200"], ["Nikon D5200", "near names", "Nikon D5100"]),
    "--camera missing file": (["--camera", "none.csv"], ["none.csv", "no such file"]),
    "--flash-spectrum unknown": (["--flash-spectrum", "xenn"], ["xenn", "xenon"]),
    "--neutral unknown": (["--neutral", "D9"], ["neutral", "D9"]),
    "--response unknown": (["--response", "Nikon D5200"], ["Nikon D5200", "Nikon D5100"]),
    "a response of no camera": (["--outputs", "response.exr"], ["response.exr needs a response"]),
    "--encoding other": (["--encoding", "gamma"], ["encoding", "linear", "srgb"]),
    "--exposure-ratio 0": (["--exposure-ratio", "0"], ["exposure_ratio"]),
    "--exposure-ratio nan": (["--exposure-ratio", "nan"], ["exposure_ratio"]),
    "--focal-px -1": (["--focal-px", "-1"], ["focal_px"]),
    "--outputs unknown": (["--outputs", "layers.exr,movie.mp4"], ["movie.mp4", "gamma.png"]),
    "an unknown flag": (["--sharpen"], ["--sharpen"]),
}


@pytest.mark.parametrize("name", BAD_FLAGS)
def test_a_bad_flag_is_refused_with_what_would_do(
    command: Command, sound: tuple[Path, Path], name: str
) -> None:
    flags, words = BAD_FLAGS[name]

    refused(command(sound, *flags), *words)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "light directions"),
        (b"[]", "lights"),
        (json.dumps(DIRECTIONS).encode(), "light_directions"),
        (json.dumps({"lights": [{"direction": [0, 0, 0]}] * 3}).encode(), "direction"),
        (json.dumps({"lights": [{"direction": [1, 0, 1], "power": 1}] * 3}).encode(), "power"),
    ],
    ids=["empty", "no lights", "one light", "no direction", "an unknown field"],
)
def test_bad_light_directions_are_refused(
    command: Command, sound: tuple[Path, Path], content: bytes, word: str
) -> None:
    lights = sound[0].with_name("lights.json")
    lights.write_bytes(content)

    refused(command(sound, "--light-directions", lights, "--lights", "3"), word)


def test_nothing_earlier_is_lost_when_a_run_is_refused(command: Command, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"text")
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("keep me")

    run = command((tmp_path / "a.png", tmp_path / "a.png"), "-o", out)

    assert run.code == 2
    assert [path.name for path in out.iterdir()] == ["mine.txt"]
