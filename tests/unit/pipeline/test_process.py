from __future__ import annotations

import hashlib
import io
import json
import subprocess
import sys
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from pipeline.arrays import Floats64
from pipeline.calibration.kept_calibrations import Kept
from pipeline.errors import (
    Canceled,
    InputError,
    OptionError,
    PairMismatchError,
    UnreadableImageError,
    UnusablePairError,
)
from pipeline.options import DirectedLight, Options
from pipeline.output_names import OUTPUT_NAMES
from pipeline.pair.pair_checks import check_pair
from pipeline.process import separate_files
from pipeline.progress import STAGES, Progress
from pipeline.taken_with import TakenWith
from tests.layers import layers_of, planes_of
from tests.unit.pipeline.separating import (
    CAMERA,
    DIRECTIONS,
    Files,
    separated,
    tiff,
)


@pytest.mark.parametrize(("count", "requested"), [(1, "auto"), (2, "auto"), (1, 1), (2, 2), (3, 3)])
def test_a_pair_becomes_layers_and_a_manifest(
    files: Callable[..., Files],
    exact: Callable[..., tuple[Any, Floats64]],
    warm_to_cool: Floats64,
    tmp_path: Path,
    count: int,
    requested: Any,
) -> None:
    manifest = separated(
        files(count),
        tmp_path / "new" / "folder",
        lights=requested,
        method="paper",
        outputs=["layers.exr"],
    )

    assert manifest["lights"]["requested"] == requested
    assert manifest["lights"]["found"] == count
    assert len(manifest["lamps"]) == count
    assert manifest["warnings"] == []
    _, layers = exact(warm_to_cool if count == 3 else warm_to_cool[[0, 2]][:count])
    found = layers_of(planes_of((tmp_path / "new" / "folder" / "layers.exr").read_bytes()), count)
    error = np.square(found - layers).sum() / np.square(layers).sum()
    assert 10 * np.log10(1 / error) > 20


def test_a_job_without_normals_loads_none_of_scipy(
    files: Callable[..., Files], tmp_path: Path
) -> None:
    """Its import would take longer than finding the lamps."""
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        "from pipeline.options import Options\n"
        "from pipeline.process import separate_files\n"
        "from pipeline.progress import Progress\n"
        "folder = Path(sys.argv[1])\n"
        "pair = [(folder / name).read_bytes() for name in ('no_flash', 'flash')]\n"
        "separate_files(*pair, Options(lights=2, exposure_ratio=1.0), folder, Progress())\n"
        "print(*(f'scipy.{name}' in sys.modules for name in ('linalg', 'optimize', 'special')))\n"
    )
    for name, content in zip(("no_flash", "flash"), files(), strict=True):
        (tmp_path / name).write_bytes(content)

    said = subprocess.check_output([sys.executable, "-c", program, str(tmp_path)], text=True)

    assert said.split() == ["False"] * 3


def test_the_manifest_is_written_as_it_is_returned(
    files: Callable[..., Files], tmp_path: Path
) -> None:
    manifest = separated(files(), tmp_path)

    text = (tmp_path / "manifest.json").read_text(encoding="utf-8")
    assert json.loads(text) == manifest
    assert text.endswith("}\n")


def test_files_are_those_of_the_manifest(files: Callable[..., Files], tmp_path: Path) -> None:
    manifest = separated(files(), tmp_path, outputs="all")

    named = {entry["name"]: entry["sha256"] for entry in manifest["files"]}
    there = {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in tmp_path.iterdir()
    }
    assert named.keys() == there.keys() - {"manifest.json"}
    assert all(there[name] == digest for name, digest in named.items())
    assert {"layers.exr", "lamp2.tif", "lamp1.jpg", "gamma.png", "white_balanced.exr"} <= set(named)
    assert not {"normals.png", "response.jpg"} & set(named)


def test_only_the_manifest_is_written_where_nothing_is_wanted(
    files: Callable[..., Files], tmp_path: Path
) -> None:
    manifest = separated(files(), tmp_path, outputs=[])

    assert manifest["files"] == []
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]


def test_inputs_are_named_by_their_digests(files: Callable[..., Files], tmp_path: Path) -> None:
    both = files()

    inputs = separated(both, tmp_path, outputs=[])["inputs"]

    for name, data in zip(("no_flash", "flash"), both, strict=True):
        assert inputs[name]["sha256"] == hashlib.sha256(data).hexdigest()
        assert (inputs[name]["width"], inputs[name]["height"]) == (96, 64)
        assert inputs[name]["encoding"] == "linear"


@pytest.mark.parametrize("method", ["best", "paper"])
def test_no_byte_depends_on_the_strips(
    shaped: tuple[Files, dict[str, Any]], tmp_path: Path, method: str
) -> None:
    both, lit = shaped
    given = {**lit, "method": method, "outputs": "all", "response": "Sigma SD1 Merrill"}

    whole = separated(both, tmp_path / "whole", **given)
    cut = separated(both, tmp_path / "cut", rows=7, **given)

    assert cut == whole
    assert {entry["name"] for entry in whole["files"]} >= {"normals.exr", "response.jpg"}
    files_of_lamps = 6  # more than names: three thrice
    assert len(whole["files"]) == len(OUTPUT_NAMES) + files_of_lamps - 3 * (method == "paper")


@pytest.mark.parametrize("align", [False, True])
def test_no_byte_depends_on_the_processors(
    align: bool, files: Callable[..., Files], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With two, strips are filtered, separated and written in a thread each; with one, here."""
    threads: dict[int, set[int]] = {1: set(), 2: set()}
    pictures = {}
    for processors, used in threads.items():
        monkeypatch.setattr(cv2, "getNumThreads", lambda number=processors: number)

        def told(stage: str, _fraction: float, used: set[int] = used) -> None:
            if stage == "layers":
                used.add(threading.get_ident())

        folder = tmp_path / str(processors)
        separated(files(), folder, Progress(told), rows=7, outputs=["layers.exr"], align=align)
        pictures[processors] = (folder / "layers.exr").read_bytes()

    assert pictures[1] == pictures[2]
    assert threads[1] == {threading.get_ident()}
    assert len(threads[2]) == 1
    assert threading.get_ident() not in threads[2]


def test_stages_run_in_order_from_zero_to_one(files: Callable[..., Files], tmp_path: Path) -> None:
    reports: list[tuple[str, float]] = []
    progress = Progress(lambda stage, fraction: reports.append((stage, fraction)))

    separated(files(), tmp_path, progress, rows=16, outputs=["gamma.png"])

    assert list(dict.fromkeys(stage for stage, _ in reports)) == list(STAGES)
    for stage in STAGES:
        fractions = [fraction for name, fraction in reports if name == stage]
        assert fractions[0] == 0
        assert fractions[-1] == 1
        assert fractions == sorted(fractions)


class Photograph(bytes):
    """A file that tells when nobody holds it any more."""

    gone: Callable[[], None]

    def __del__(self) -> None:
        self.gone()


def test_photographs_are_let_go_as_soon_as_they_are_decoded(
    files: Callable[..., Files], tmp_path: Path
) -> None:
    no_flash, flash = (Photograph(file) for file in files())
    heard: list[str] = []
    no_flash.gone = lambda: heard.append("no flash")
    flash.gone = lambda: heard.append("flash")
    progress = Progress(lambda stage, fraction: heard.append(f"{stage} {fraction}"))
    given = [flash, no_flash]
    del no_flash, flash

    separate_files(
        given.pop(), given.pop(), Options(**CAMERA, outputs=["gamma.png"]), tmp_path, progress
    )

    assert heard[:5] == ["decode 0.0", "no flash", "decode 0.5", "flash", "decode 1.0"]


@pytest.mark.parametrize("stage", STAGES)
def test_a_run_can_be_canceled_in_every_stage(
    files: Callable[..., Files], tmp_path: Path, stage: str
) -> None:
    reports: list[str] = []
    progress = Progress(lambda name, _: reports.append(name), lambda: stage in reports)

    with pytest.raises(Canceled):
        separated(files(), tmp_path, progress, outputs=["gamma.png"])

    assert reports[-1] == stage
    assert not (tmp_path / "manifest.json").exists()


def test_a_canceled_run_does_not_begin(files: Callable[..., Files], tmp_path: Path) -> None:
    with pytest.raises(Canceled):
        separated(files(), tmp_path / "out", Progress(canceled=lambda: True))

    assert not (tmp_path / "out").exists()


def _contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_run_that_ends_while_it_writes_leaves_no_manifest_of_the_run_before(
    files: Callable[..., Files], tmp_path: Path
) -> None:
    """It would name files that are gone."""
    separated(files(), tmp_path, outputs=["lamps.tif", "confidence.tif"])
    stages: list[str] = []
    progress = Progress(lambda stage, _: stages.append(stage), lambda: "layers" in stages)

    with pytest.raises(Canceled):
        separated(files(), tmp_path, progress, rows=16, outputs=["confidence.tif"])

    assert _contents(tmp_path).keys() == {"lamp1.tif", "lamp2.tif"}


def test_files_of_a_run_before_are_written_over(
    files: Callable[..., Files], tmp_path: Path
) -> None:
    separated(files(), tmp_path, outputs=["confidence.tif", "gamma.png"])
    manifest = separated(files(1), tmp_path, outputs=["gamma.png"])

    assert json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8")) == manifest
    (entry,) = manifest["files"]
    assert entry["sha256"] == hashlib.sha256(_contents(tmp_path)["gamma.png"]).hexdigest()


@pytest.mark.parametrize(
    ("options", "stage", "error"),
    [
        ({"camera": "Nikon D5"}, None, OptionError),
        ({"exposure_ratio": 500.0}, None, UnusablePairError),
        ({}, "lamps", Canceled),
    ],
    ids=["an option", "a pair", "canceled"],
)
def test_a_run_that_writes_nothing_leaves_the_results_of_the_run_before(
    files: Callable[..., Files],
    tmp_path: Path,
    options: dict[str, Any],
    stage: str | None,
    error: type[Exception],
) -> None:
    separated(files(), tmp_path, outputs=["gamma.png"])
    before = _contents(tmp_path)
    stages: list[str] = []
    progress = Progress(lambda name, _: stages.append(name), lambda: stage in stages)

    with pytest.raises(error):
        separated(files(), tmp_path, progress, outputs=["gamma.png"], **options)

    assert _contents(tmp_path) == before


# bad input


@pytest.mark.parametrize(
    ("bad", "error"),
    [
        (b"", UnreadableImageError),
        (b"Dear Sir or Madam", UnreadableImageError),
        (tiff(np.full((64, 95, 3), 0.3)), PairMismatchError),
    ],
    ids=["empty", "text", "another size"],
)
@pytest.mark.parametrize("which", [0, 1])
def test_bad_files_are_refused_by_check_and_run(
    files: Callable[..., Files],
    tmp_path: Path,
    bad: bytes,
    error: type[InputError],
    which: int,
) -> None:
    both = list(files())
    both[which] = bad

    with pytest.raises(error) as by_check:
        check_pair(both[0], both[1])
    with pytest.raises(error) as by_run:
        separated((both[0], both[1]), tmp_path / "out")

    assert str(by_check.value) == str(by_run.value)
    assert str(by_check.value).count(".") <= 2
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"camera": "Acme One"}, OptionError, "No camera is called 'Acme One'"),
        ({"flash_spectrum": "moonbeam"}, OptionError, "No flash spectrum is called 'moonbeam'"),
        ({"neutral": "candlestick"}, OptionError, "No neutral light spectrum is called"),
        ({"response": "Acme Two"}, OptionError, "No camera is called 'Acme Two'"),
        (
            {"light_directions": [DirectedLight(direction=(0, 0, 1))] * 3},
            OptionError,
            "nearly in one plane",
        ),
        ({"light_directions": DIRECTIONS, "lights": 2}, OptionError, "3 light directions"),
        ({"exposure_ratio": 500.0}, UnusablePairError, "darker"),
    ],
)
def test_bad_options_end_in_a_sentence_and_without_results(
    files: Callable[..., Files],
    tmp_path: Path,
    options: dict[str, Any],
    error: type[InputError],
    words: str,
) -> None:
    with pytest.raises(error, match=words):
        separated(files(), tmp_path / "out", **options)

    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"light_directions": [DirectedLight(direction=(0, 0, 1))] * 3}, "nearly in one plane"),
        ({"outputs": ["normals.png"]}, "The output normals.png needs the lamps' directions"),
    ],
)
def test_directions_that_fix_no_normals_are_refused_before_any_work(
    tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(OptionError, match=words):
        separated((b"never", b"read"), tmp_path / "out", **options)


@pytest.mark.parametrize(
    ("of", "said"),
    [
        ("D5100", "since normals need two lamps at least, and one is kept: calibrate with all "),
        ("D850", "Nothing that is kept for the set-up 'table' fits this camera, "),
    ],
)
def test_why_kept_lamps_give_no_normals_is_told_once_the_photographs_are_read(
    files: Callable[..., Files], tmp_path: Path, of: str, said: str
) -> None:
    kept = Kept(
        kind="lamps",
        setup="table",
        name="a",
        made="2026",
        taken_with=TakenWith(make="NIKON", model=of, encoding="linear"),
        content='{"lights": [{"direction": [0, 0, 1]}]}',
    )
    both = files(write=partial(tiff, camera=("NIKON", "D5100")))
    options = Options(setup="table", outputs=["normals.png"])

    with pytest.raises(OptionError, match=f"needs the lamps' directions.*{said}"):
        separate_files(*both, options, tmp_path / "out", Progress(), kept=[kept])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_pixels_that_are_no_numbers_are_refused(
    files: Callable[..., Files], tmp_path: Path, value: float
) -> None:
    no_flash, _ = files()
    flash = np.full((64, 96, 3), 0.5)
    flash[10:12, 20] = value

    with pytest.raises(UnreadableImageError, match="photograph with the flash holds values"):
        separated((no_flash, tiff(flash)), tmp_path / "out")

    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"pinned_lamps": [{"x": 5000, "y": 5, "radius": 9}]}, "pinned lamp 1 has its middle at"),
        ({"outputs": ["layers.psd"]}, r"layers\.psd cannot hold 3 layers"),
    ],
)
def test_what_the_size_tells_is_refused_before_the_photographs_are_laid_together(
    files: Callable[..., Files],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: dict[str, Any],
    said: str,
) -> None:
    both = files()
    height, width = tifffile.imread(io.BytesIO(both[0])).shape[:2]
    # room for two layers beside the photograph
    monkeypatch.setattr("pipeline.encode.psd_size._LARGEST_BYTES", 3 * 6 * width * height)
    stages: list[str] = []

    with pytest.raises(OptionError, match=said):
        separated(both, tmp_path, Progress(lambda stage, _: stages.append(stage)), **options)

    assert set(stages) == {"decode"}
