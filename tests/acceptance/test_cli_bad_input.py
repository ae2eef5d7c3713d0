"""Bad photographs and bad flags end in exit code 2, one sentence on stderr, and no folder."""

from __future__ import annotations

import io
import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as PillowImage

Command = Callable[..., Any]


def picture(codes: NDArray[np.uint8], kind: str = "PNG") -> bytes:
    file = io.BytesIO()
    PillowImage.fromarray(codes).save(file, kind)
    return file.getvalue()


def sound(width: int = 96, height: int = 64, brightness: float = 1.0) -> bytes:
    rng = np.random.default_rng(width)
    return picture((rng.uniform(20, 120, (height, width, 3)) * brightness).astype(np.uint8))


def bomb() -> bytes:
    """A PNG of 30,000 × 30,000 pixels in few bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    side, rows = 30_000, 100
    packer = zlib.compressobj(9, wbits=-15)
    packed = packer.compress(bytes(rows * (3 * side + 1))) + packer.flush(zlib.Z_FULL_FLUSH)
    checksum = struct.pack(">HH", side * (3 * side + 1) % 65521, 1)  # Adler-32 of zeros
    body = b"\x78\xda" + packed * (side // rows) + b"\x03\x00" + checksum
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0))
        + chunk(b"IDAT", body)
        + chunk(b"IEND", b"")
    )


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


GOOD = sound()
JPEG = picture(np.random.default_rng(1).integers(0, 255, (64, 96, 3), dtype=np.uint8), "JPEG")
BAD_FILES = {
    "text": (b"This is no photograph.\n" * 40, "of a kind that is not read"),
    "nothing": (b"", "is empty"),
    "half a JPEG": (JPEG[: len(JPEG) // 2], "damaged or incomplete JPEG"),
    "a bomb": (bomb(), "30000 × 30000 pixels, more than the limit"),
    "grey": (picture(np.full((64, 96), 90, np.uint8)), "is grey"),
}


@pytest.mark.parametrize("frame", ["no-flash photograph", "flash photograph"])
@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_photograph_is_named(command: Command, tmp_path: Path, name: str, frame: str) -> None:
    content, reason = BAD_FILES[name]
    bad, good = tmp_path / "holiday.jpg", tmp_path / "good.png"
    bad.write_bytes(content)
    good.write_bytes(GOOD)

    run = command((bad, good) if frame == "no-flash photograph" else (good, bad))

    refused(run, f"The {frame} ", reason)


BAD_PAIRS: dict[str, tuple[bytes, bytes, list[str]]] = {
    "two sizes": (sound(96, 64), sound(64, 96, 2), ["96 × 64", "64 × 96"]),
    "two identical frames": (GOOD, GOOD, ["identical"]),
    "a black no-flash frame": (
        picture(np.zeros((64, 96, 3), np.uint8)),
        GOOD,
        ["no-flash", "black"],
    ),
    "a black flash frame": (GOOD, picture(np.zeros((64, 96, 3), np.uint8)), ["flash"]),
}


@pytest.mark.parametrize("name", BAD_PAIRS)
def test_a_pair_that_is_none_is_refused(command: Command, tmp_path: Path, name: str) -> None:
    first, second, words = BAD_PAIRS[name]
    paths = (tmp_path / "a.png", tmp_path / "b.png")
    paths[0].write_bytes(first)
    paths[1].write_bytes(second)

    refused(command(paths), *words)


def test_a_missing_file_is_refused(command: Command, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(GOOD)

    refused(command((tmp_path / "a.png", tmp_path / "b.png")), "b.png", "no such file")


DIRECTIONS = {"lights": [{"direction": [1, 0, 1]}, {"direction": [-1, 0, 1]}]}
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
    "--encoding other": (["--encoding", "gamma"], ["encoding", "linear", "srgb"]),
    "--exposure-ratio 0": (["--exposure-ratio", "0"], ["exposure_ratio"]),
    "--exposure-ratio nan": (["--exposure-ratio", "nan"], ["exposure_ratio"]),
    "--focal-px -1": (["--focal-px", "-1"], ["focal_px"]),
    "--outputs unknown": (["--outputs", "layers.exr,movie.mp4"], ["movie.mp4", "gamma.png"]),
    "an unknown flag": (["--sharpen"], ["--sharpen"]),
}


@pytest.mark.parametrize("name", BAD_FLAGS)
def test_a_bad_flag_is_refused_with_what_would_do(
    command: Command, tmp_path: Path, name: str
) -> None:
    flags, words = BAD_FLAGS[name]
    paths = (tmp_path / "a.png", tmp_path / "b.png")
    paths[0].write_bytes(GOOD)
    paths[1].write_bytes(sound(brightness=2))

    refused(command(paths, *flags), *words)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "light directions"),
        (b"[]", "lights"),
        (json.dumps(DIRECTIONS).encode(), "light_directions"),
        (json.dumps({"lights": [{"direction": [0, 0, 0]}] * 3}).encode(), "direction"),
        (json.dumps({"lights": [{"direction": [1, 0, 1], "power": 1}] * 3}).encode(), "power"),
    ],
    ids=["empty", "no lights", "two lights", "no direction", "an unknown field"],
)
def test_bad_light_directions_are_refused(
    command: Command, tmp_path: Path, content: bytes, word: str
) -> None:
    paths = (tmp_path / "a.png", tmp_path / "b.png")
    paths[0].write_bytes(GOOD)
    paths[1].write_bytes(sound(brightness=2))
    (tmp_path / "lights.json").write_bytes(content)

    refused(command(paths, "--light-directions", tmp_path / "lights.json", "--lights", "3"), word)


def test_nothing_earlier_is_lost_when_a_run_is_refused(command: Command, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"text")
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("keep me")

    run = command((tmp_path / "a.png", tmp_path / "a.png"), "-o", out)

    assert run.code == 2
    assert [path.name for path in out.iterdir()] == ["mine.txt"]
