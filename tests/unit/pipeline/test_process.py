from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as PillowImage

from pipeline.colour.curves import linear_to_srgb
from pipeline.colour.icc import linear_rec2020_profile
from pipeline.errors import (
    Canceled,
    InputError,
    OptionError,
    PairMismatchError,
    UnreadableImageError,
    UnusablePairError,
)
from pipeline.options import OUTPUT_NAMES, DirectedLight, Options
from pipeline.process import check_pair, separate_files
from pipeline.progress import STAGES, Progress
from pipeline.remarks import Code, Remark
from pipeline.spectra.cameras import Camera, srgb_stand_in
from tests.ball import make_ball

Array = NDArray[np.float64]
Files = tuple[bytes, bytes]
CAMERA: dict[str, Any] = {"camera": "Nikon D5100", "exposure_ratio": 1.0, "align": False}
DIRECTIONS = [DirectedLight(direction=d) for d in ((0.6, 0.2, 1), (-0.5, 0.5, 1), (0.1, -0.7, 1))]


def tiff(values: NDArray[np.floating], camera: tuple[str, str] | None = None) -> bytes:
    """A float TIFF, read as linear. camera: the make and model that it names."""
    file = io.BytesIO()
    tags = [(271 + i, 2, 0, name, True) for i, name in enumerate(camera or ())]
    data = values.astype(np.float32)
    tifffile.imwrite(file, data, photometric="rgb", metadata=None, extratags=tags)
    return file.getvalue()


def png(values: NDArray[np.floating]) -> bytes:
    """An 8-bit PNG, read as sRGB."""
    file = io.BytesIO()
    codes = np.round(255 * linear_to_srgb(np.clip(values.astype(np.float64), 0, 1)))
    PillowImage.fromarray(codes.astype(np.uint8)).save(file, "PNG")
    return file.getvalue()


@pytest.fixture
def files(exact: Callable[..., tuple[Any, Array]], warm_to_cool: Array) -> Callable[..., Files]:
    """The files of a pair with one to three lamps that the model describes exactly."""

    def build(count: int = 2, write: Callable[..., bytes] = tiff) -> Files:
        pair, _ = exact(warm_to_cool if count == 3 else warm_to_cool[[0, 2]][:count])
        return write(pair.no_flash), write(pair.flash)

    return build


@pytest.fixture
def shaped(camera: Camera) -> tuple[Files, dict[str, Any]]:
    """The files of a ball in three colours under three lamps, and options that name the lamps."""
    ball = make_ball(camera.sensitivities, size=40, materials=3)
    given = {
        "lights": 3,
        "light_directions": ball.lights("strength", "rgb"),
        "focal_px": ball.focal_px,
    }
    return (tiff(0.3 * ball.light), tiff(0.3 * (ball.light + ball.flash))), given


def separated(
    files: Files, folder: Path, progress: Progress | None = None, rows: int = 256, **options: Any
) -> dict[str, Any]:
    given = Options(**{**CAMERA, **options})
    return separate_files(*files, given, folder, progress or Progress(), rows)


def layers_of(folder: Path, count: int) -> NDArray[np.float32]:
    """(N, H, W, 3) of layers.exr."""
    channels = OpenEXR.File(str(folder / "layers.exr"), separate_channels=True).channels()
    return np.stack(
        [
            np.stack([channels[f"lamp{j + 1}.{letter}"].pixels for letter in "RGB"], axis=-1)
            for j in range(count)
        ]
    )


@pytest.mark.parametrize(("count", "requested"), [(1, "auto"), (2, "auto"), (1, 1), (2, 2), (3, 3)])
def test_a_pair_becomes_layers_and_a_manifest(
    files: Callable[..., Files],
    exact: Callable[..., tuple[Any, Array]],
    warm_to_cool: Array,
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
    found = layers_of(tmp_path / "new" / "folder", count)
    error = np.square(found - layers).sum() / np.square(layers).sum()
    assert 10 * np.log10(1 / error) > 20


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


# warnings


def codes(manifest: dict[str, Any]) -> list[str]:
    return [warning["code"] for warning in manifest["warnings"]]


def test_rendered_files_are_warned_of(files: Callable[..., Files], tmp_path: Path) -> None:
    manifest = separated(files(write=png), tmp_path, camera=None, outputs=[])

    assert "rendered_srgb" in codes(manifest)
    assert manifest["camera"] == {"name": "sRGB", "source": "stand-in"}


def test_an_unknown_sensor_is_told_by_the_pair_and_warned_of(
    files: Callable[..., Files], tmp_path: Path
) -> None:
    manifest = separated(files(), tmp_path, camera=None, outputs=[])

    assert manifest["camera"] == {"name": "typical sensor", "source": "stand-in"}
    (warning,) = (w for w in manifest["warnings"] if w["code"] == "camera_approximate")
    assert "typical sensor explains the pair best and was taken" in warning["message"]


def test_who_names_a_camera_for_renderings_hears_that_it_says_nothing_of_them(
    files: Callable[..., Files], tmp_path: Path
) -> None:
    named = separated(files(write=png), tmp_path / "named", outputs=[])
    silent = separated(files(write=png), tmp_path / "silent", camera=None, outputs=[])

    messages = [
        warning["message"]
        for manifest in (named, silent)
        for warning in manifest["warnings"]
        if warning["code"] == "rendered_srgb"
    ]
    assert ["leave it out" in message for message in messages] == [True, False]


def rec2020(values: NDArray[np.floating]) -> bytes:
    """A 16-bit TIFF of a camera that is measured, with a linear profile."""
    file = io.BytesIO()
    tifffile.imwrite(
        file,
        np.round(65535 * np.clip(values, 0, 1)).astype(np.uint16),
        photometric="rgb",
        metadata=None,
        iccprofile=linear_rec2020_profile(),
        extratags=[(271, 2, 0, "NIKON CORPORATION", True), (272, 2, 0, "NIKON D5100", True)],
    )
    return file.getvalue()


def test_linear_files_that_say_their_colours_are_srgb_and_nothing_is_guessed(
    files: Callable[..., Files], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.process.likely_camera", lambda *_: pytest.fail("guessed"))
    both = files(write=rec2020)

    silent = separated(both, tmp_path / "silent", camera=None, outputs=[])
    named = separated(both, tmp_path / "named", outputs=[])

    assert silent["camera"] == {"name": "sRGB", "source": "stand-in"}
    assert named["camera"] == {"name": "Nikon D5100", "source": "measured"}
    messages = [
        warning["message"]
        for manifest in (named, silent)
        for warning in manifest["warnings"]
        if warning["code"] == "camera_approximate"
    ]
    assert ["in the colours that their profile says" in text for text in messages] == [True, True]
    assert ["leave it out" in text for text in messages] == [True, False]


@pytest.mark.parametrize("named", [True, False])
def test_a_camera_that_is_named_may_be_doubted(
    files: Callable[..., Files], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: bool
) -> None:
    given: list[tuple[Any, ...]] = []

    def doubt(*those: Any) -> list[Remark]:
        given.append(those)
        return [Remark(Code.CAMERA_DOUBTFUL, "Check the camera.")]

    monkeypatch.setattr("pipeline.process.camera_doubts", doubt)
    camera = "Sigma SD1 Merrill" if named else None

    manifest = separated(files(), tmp_path, lights=2, camera=camera, outputs=[])

    assert codes(manifest).count("camera_doubtful") == named
    assert [(lamps, camera.name) for _, lamps, _, camera, _, _ in given] == (
        [(2, "Sigma SD1 Merrill")] if named else []
    )


@pytest.mark.parametrize("taken", [False, True])
def test_of_linear_files_of_a_known_camera_the_pair_tells_whether_they_hold_its_values(
    files: Callable[..., Files], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, taken: bool
) -> None:
    sensors: list[Camera] = []

    def likely(*given: Any) -> Camera:
        sensors.append(given[4])
        return given[4] if taken else srgb_stand_in()

    monkeypatch.setattr("pipeline.process.likely_camera", likely)
    both = files(write=partial(tiff, camera=("NIKON CORPORATION", "NIKON D5100")))

    manifest = separated(both, tmp_path, camera=None, outputs=[])

    assert [sensor.name for sensor in sensors] == ["Nikon D5100"]
    messages = [w["message"] for w in manifest["warnings"] if w["code"] == "camera_approximate"]
    assert manifest["camera"]["name"] == ("Nikon D5100" if taken else "sRGB")
    assert ["not hold what the sensor of the Nikon D5100" in text for text in messages] == (
        [] if taken else [True]
    )


@pytest.mark.parametrize("told", [False, True])
def test_an_unknown_focal_length_is_warned_of(
    shaped: tuple[Files, dict[str, Any]], tmp_path: Path, told: bool
) -> None:
    both, lit = shaped
    given = lit if told else {**lit, "focal_px": None}

    manifest = separated(both, tmp_path, **given, method="paper", outputs=["normals.png"])

    assert ("focal_length_assumed" in codes(manifest)) is not told
    assert manifest["normals"] is not None


def test_nobody_asks_where_surfaces_face_so_nobody_looks(
    shaped: tuple[Files, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Calibrated directions come with every later job, also with those that want pictures alone."""
    both, lit = shaped
    monkeypatch.setattr("pipeline.process.find_facing", lambda *_: pytest.fail("looked"))

    manifest = separated(both, tmp_path, **{**lit, "focal_px": None}, outputs=["lamps.jpg"])

    assert manifest["normals"] is None
    assert "focal_length_assumed" not in codes(manifest)


def test_what_no_jpeg_holds_is_refused_before_the_work(
    files: Callable[..., Files], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.encode.jpeg._LONGEST", 50)
    monkeypatch.setattr("pipeline.process.make_pair", lambda *_: pytest.fail("worked"))

    with pytest.raises(OptionError, match="A JPEG cannot hold 96 × 64 pixels"):
        separated(files(), tmp_path, outputs=["lamps.jpg"])


def test_what_was_filled_in_is_warned_of(
    exact: Callable[..., tuple[Any, Array]], warm_to_cool: Array, tmp_path: Path
) -> None:
    """The flash does not reach the lower half."""
    pair, _ = exact(warm_to_cool[[0, 2]])
    part = pair.flash - pair.no_flash
    part[32:] = 0

    manifest = separated((tiff(pair.no_flash), tiff(pair.no_flash + part)), tmp_path, outputs=[])

    assert manifest["filled"] == pytest.approx(0.5, abs=0.05)
    assert "flash_too_weak" in codes(manifest)


# bad input


def test_sound_files_pass_the_check(files: Callable[..., Files]) -> None:
    check_pair(*files())
    check_pair(*files(write=png))


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


def test_the_bad_one_of_two_files_is_named(files: Callable[..., Files]) -> None:
    no_flash, flash = files()

    with pytest.raises(UnreadableImageError, match="photograph without the flash"):
        check_pair(b"nothing", flash)
    with pytest.raises(UnreadableImageError, match="photograph with the flash"):
        check_pair(no_flash, b"nothing")


def test_one_file_twice_is_refused(files: Callable[..., Files]) -> None:
    no_flash, _ = files()

    with pytest.raises(UnusablePairError, match="identical"):
        check_pair(no_flash, no_flash)


def test_tiny_pictures_are_refused() -> None:
    with pytest.raises(UnusablePairError, match="only 31 × 40 pixels"):
        check_pair(tiff(np.full((40, 31, 3), 0.3)), tiff(np.full((40, 31, 3), 0.4)))


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
        ({"exposure_ratio": 1e9}, OptionError, "exposure ratio"),
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
