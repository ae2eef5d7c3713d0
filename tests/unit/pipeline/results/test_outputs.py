from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as PillowImage

from pipeline.arrays import Floats64
from pipeline.errors import Canceled
from pipeline.light.model import build_model
from pipeline.output_names import OUTPUT_NAMES
from pipeline.photometric_stereo.facing import Facing
from pipeline.progress import Progress
from pipeline.results import outputs
from pipeline.results.pictures import Pictures
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light
from tests.layers import planes_of


def shown(path: Path) -> NDArray[np.uint8]:
    """Code values of a picture."""
    with PillowImage.open(path) as picture:
        return np.asarray(picture)


SIZE = (40, 64)
HALF = 2**-11  # relative rounding of a half float


@pytest.mark.parametrize(
    ("wanted", "names"),
    [
        ((), []),
        (("layers.exr",), ["layers.exr"]),
        (("lamps.tif",), ["lamp1.tif", "lamp2.tif"]),
        (("lamps.jpg",), ["lamp1.jpg", "lamp2.jpg"]),
        (("layers.psd",), ["layers.psd"]),
        (("white_balanced_1.jpg",), ["white_balanced_1.jpg"]),
        (("white_balanced_2.jpg",), ["white_balanced_2.jpg"]),
        (("white_balanced_1.tif",), ["white_balanced_1.tif"]),
        (("white_balanced_2.tif",), ["white_balanced_2.tif"]),
        (("white_balanced.exr",), ["white_balanced.exr"]),
        (("normals.png", "normals.exr"), ["normals.exr", "normals.png"]),
        (("depth.exr",), ["depth.exr"]),
        (("surface.glb",), ["surface.glb"]),
        (("confidence.tif",), ["confidence.tif"]),
        (("normals_confidence.tif",), ["normals_confidence.tif"]),
        (("gamma.png",), ["gamma.png"]),
        (("residual.png",), ["residual.png"]),
        (("preview.exr",), ["preview.exr"]),
        (("thumbnail.jpg",), ["thumbnail.jpg"]),
        (("response.jpg", "response_lamps.jpg", "response.exr"), []),
    ],
)
def test_what_is_wanted_is_written_and_nothing_else(
    written: Callable[..., list[dict[str, Any]]],
    tmp_path: Path,
    wanted: tuple[str, ...],
    names: list[str],
) -> None:
    entries = written(*wanted)

    assert sorted(entry["name"] for entry in entries) == names
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_without_directions_there_are_neither_normals_nor_a_surface(
    written: Callable[..., list[dict[str, Any]]],
) -> None:
    names = [entry["name"] for entry in written(*OUTPUT_NAMES, facing=None)]

    assert names == [
        "layers.exr",
        *(f"lamp{i}.{kind}" for i in (1, 2) for kind in ("tif", "jpg")),
        "layers.psd",
        *(f"white_balanced_{i}.{kind}" for kind in ("jpg", "tif") for i in (1, 2)),
        "white_balanced.exr",
        "confidence.tif",
        "preview.exr",
        "thumbnail.jpg",
        "gamma.png",
        "residual.png",
    ]


def test_normals_without_a_surface_have_neither_depth_nor_confidence(
    written: Callable[..., list[dict[str, Any]]], facing: Facing
) -> None:
    names = {"normals.png", "normals.exr", "normals_confidence.tif", "depth.exr", "surface.glb"}

    entries = written(*names, facing=replace(facing, surface=None))

    assert [entry["name"] for entry in entries] == ["normals.png", "normals.exr"]


def test_entries_describe_the_files(
    written: Callable[..., list[dict[str, Any]]], tmp_path: Path
) -> None:
    entries = {entry["name"]: entry for entry in written(*OUTPUT_NAMES)}

    for name, entry in entries.items():
        assert entry["sha256"] == hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()
        if name == "surface.glb":
            assert "width" not in entry
            assert "y up" in entry["encoding"]
            continue
        size = {"gamma.png": (900, 1050), "residual.png": (960, 760)}.get(name, (64, 40))
        assert (entry["width"], entry["height"]) == size
    assert entries["lamp1.tif"]["colour_space"] == "Rec. 2020"
    assert entries["lamp1.tif"]["encoding"] == "16-bit linear"
    assert entries["lamp2.jpg"]["colour_space"] == "sRGB"
    assert entries["layers.exr"]["encoding"] == "16-bit float"
    assert "white level of the no-flash photograph" in entries["layers.exr"]["colour_space"]
    assert "neutral light" in entries["white_balanced.exr"]["colour_space"]
    assert "y up" in entries["normals.png"]["colour_space"]
    assert "1 in the median" in entries["depth.exr"]["encoding"]
    assert entries["confidence.tif"]["encoding"].startswith("16-bit linear, 65535 = separated")


def test_white_balanced_pictures_are_written_as_half_floats(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path
) -> None:
    written("white_balanced.exr")

    channels = planes_of((tmp_path / "white_balanced.exr").read_bytes())
    assert set(channels) == {"R", "G", "B", "any.R", "any.G", "any.B"}
    for picture, prefix in ((pictures.white_balanced_1, ""), (pictures.white_balanced_2, "any.")):
        found = np.stack([channels[f"{prefix}{name}"] for name in "RGB"], axis=-1)
        np.testing.assert_array_equal(found, np.asarray(picture, np.float16))


def test_layers_are_written_as_half_floats_with_their_sum(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path
) -> None:
    written("layers.exr")

    channels = planes_of((tmp_path / "layers.exr").read_bytes())
    assert set(channels) == {*"RGB", *(f"lamp{i}.{c}" for i in (1, 2) for c in "RGB")}
    for k, letter in enumerate("RGB"):
        for i in (0, 1):
            np.testing.assert_array_equal(
                channels[f"lamp{i + 1}.{letter}"], pictures.layers[i, ..., k].astype(np.float16)
            )
        np.testing.assert_allclose(
            channels[letter], pictures.layers[..., k].sum(axis=0), rtol=HALF, atol=2**-24
        )


def test_unknown_normals_are_kept_apart(
    written: Callable[..., list[dict[str, Any]]], tmp_path: Path
) -> None:
    written("normals.exr", "depth.exr")

    for name, channel, known in (("normals.exr", "B", 1), ("depth.exr", "Z", 1.25)):
        plane = planes_of((tmp_path / name).read_bytes())[channel]
        assert np.isnan(plane[:5]).all()
        assert (plane[5:] == known).all()


def test_a_preview_has_the_layers_and_their_confidence(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path
) -> None:
    written("preview.exr")

    channels = planes_of((tmp_path / "preview.exr").read_bytes())
    assert set(channels) == {"Y", *(f"lamp{i}.{c}" for i in (1, 2) for c in "RGB")}
    np.testing.assert_array_equal(channels["Y"], pictures.confidence.astype(np.float16))
    np.testing.assert_array_equal(
        channels["lamp2.G"], pictures.layers[1, ..., 1].astype(np.float16)
    )


def test_lamps_are_named_in_the_diagram_by_family_and_temperature(
    written: Callable[..., list[dict[str, Any]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[list[str]] = []

    def draw(*given: Any) -> NDArray[np.uint8]:
        drawn.append(given[-1])
        return np.zeros((1, 1, 3), np.uint8)

    monkeypatch.setattr(outputs, "draw_gamma_diagram", draw)

    written("gamma.png")

    assert drawn == [["lamp1, incandescent 93%, 2850 K", "lamp2, RGB LED 40%"]]


def test_black_pictures_are_written_black(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path
) -> None:
    black = np.zeros((40, 64, 3), np.float32)
    dark = replace(
        pictures,
        layers=np.stack([black, black]),
        shown_layers=np.stack([black, black]),
        white_balanced_1=black,
        white_balanced_2=black,
        normals=np.full((40, 64, 3), np.nan, np.float32),
    )

    entries = written(*OUTPUT_NAMES, given=dark)

    assert len(entries) == 21
    for name in ("lamp1.jpg", "white_balanced_1.jpg", "white_balanced_2.jpg"):
        assert not shown(tmp_path / name).any()


def test_confidence_is_written_as_16_bit_grey(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path
) -> None:
    written("confidence.tif")

    with tifffile.TiffFile(tmp_path / "confidence.tif") as file:
        assert file.pages.first.photometric == tifffile.PHOTOMETRIC.MINISBLACK
        codes = file.asarray()
    assert codes.dtype == np.uint16
    assert pictures.confidence is not None
    np.testing.assert_allclose(codes / 65535, pictures.confidence, atol=1 / 65535)
    assert (codes[0, 0], codes[-1, -1]) == (0, 65535)


def test_the_confidence_of_normals_is_their_own(
    written: Callable[..., list[dict[str, Any]]], tmp_path: Path
) -> None:
    written("normals_confidence.tif")

    codes = tifffile.imread(tmp_path / "normals_confidence.tif")
    np.testing.assert_array_equal(codes, np.full(SIZE, 32768))


CHANGES = np.array([np.diag([2.0, 1.0, 0.5]), [[0.0, 1, 0], [1, 0, 0], [0, 0, 1]]])
"""Of each lamp's layer through the other camera: other gains; red and green exchanged."""


@pytest.fixture
def responded(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, camera: Camera
) -> Callable[..., list[dict[str, Any]]]:
    """Write outputs through another camera, which is the same with other names for channels."""
    model = build_model(camera, find_light("xenon"), find_light("D65"), "wpca", camera)
    seen = np.einsum("nhwl,nkl->hwk", pictures.layers, CHANGES).astype(np.float32)
    return partial(written, given=replace(pictures, response=seen), changes=CHANGES, by=model)


@pytest.mark.parametrize(
    ("wanted", "names"),
    [
        ("response.jpg", ["response.jpg"]),
        ("response_lamps.jpg", ["response_lamp1.jpg", "response_lamp2.jpg"]),
        ("response.exr", ["response.exr"]),
        ("gamma.png", ["gamma.png"]),
    ],
)
def test_responses_that_are_wanted_are_written(
    responded: Callable[..., list[dict[str, Any]]], tmp_path: Path, wanted: str, names: list[str]
) -> None:
    assert [entry["name"] for entry in responded(wanted)] == names
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_layers_through_the_other_camera_are_written_with_their_sum(
    responded: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path
) -> None:
    (entry,) = responded("response.exr")

    channels = planes_of((tmp_path / "response.exr").read_bytes())
    assert set(channels) == {*"RGB", *(f"lamp{i}.{c}" for i in (1, 2) for c in "RGB")}
    first, second = pictures.layers
    for letter, one, two in (
        ("R", 2 * first[..., 0], second[..., 1]),
        ("G", first[..., 1], second[..., 0]),
        ("B", 0.5 * first[..., 2], second[..., 2]),
    ):
        np.testing.assert_allclose(channels[f"lamp1.{letter}"], one, rtol=HALF, atol=2**-24)
        np.testing.assert_allclose(channels[f"lamp2.{letter}"], two, rtol=HALF, atol=2**-24)
        np.testing.assert_allclose(channels[letter], one + two, rtol=HALF, atol=2**-24)
    assert "other camera" in entry["colour_space"]


def test_layers_through_the_other_camera_are_shown_on_the_scale_of_the_photograph(
    responded: Callable[..., list[dict[str, Any]]], tmp_path: Path
) -> None:
    """Light adds up: the sum of the linear layers is the linear photograph."""
    responded("response.jpg", "response_lamps.jpg")

    def light(name: str) -> Floats64:
        code = shown(tmp_path / name) / 255
        return np.where(code < 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)

    whole, first, second = map(light, ("response.jpg", "response_lamp1.jpg", "response_lamp2.jpg"))
    np.testing.assert_allclose(first.mean() + second.mean(), whole.mean(), rtol=0.1)
    assert first[..., 2].mean() < 0.8 * second[..., 2].mean()


def test_cancel_stops_between_files_and_leaves_none(
    written: Callable[..., list[dict[str, Any]]], tmp_path: Path
) -> None:
    reports: list[float] = []
    progress = Progress(lambda _, part: reports.append(part), lambda: len(reports) == 3)

    with pytest.raises(Canceled):
        written("layers.exr", "lamps.jpg", "gamma.png", "residual.png", progress=progress)

    assert reports == pytest.approx([0, 0.2, 0.4])
    assert not list(tmp_path.iterdir())


def test_a_run_that_breaks_off_leaves_no_files(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path
) -> None:
    """Of files that were there before, only those that it had begun to write are gone."""
    for name in ("lamp1.tif", "notes.txt"):
        (tmp_path / name).write_text("there")
    torn = replace(pictures, confidence=np.ones((40, 3), np.float32), white_balanced_1=None)

    with pytest.raises(AttributeError):
        written("layers.exr", "lamps.tif", "white_balanced_1.tif", given=torn)

    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_a_file_whose_opening_breaks_off_is_not_left(
    written: Callable[..., list[dict[str, Any]]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, **_: Any) -> None:
        path.write_bytes(b"begun")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(outputs, "TiffFile", full)

    with pytest.raises(OSError, match="No space left"):
        written("layers.exr", "lamps.tif")

    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_missing_is_an_error_of_the_system(
    written: Callable[..., list[dict[str, Any]]], tmp_path: Path
) -> None:
    tmp_path.rmdir()

    with pytest.raises(OSError, match="lamp1"):
        written("lamps.tif")


def test_normals_follow_the_convention_asked_for(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path
) -> None:
    upward = np.broadcast_to(np.array([0.6, 0.48, 0.64], np.float32), (*SIZE, 3))
    given = replace(pictures, normals=upward)
    for convention, y, words in (("gl", 0.48, "y up"), ("dx", -0.48, "y down")):
        entries = written("normals.png", "normals.exr", given=given, convention=convention)
        assert all(words in entry["colour_space"] for entry in entries)
        exact = planes_of((tmp_path / "normals.exr").read_bytes())
        for name, value in zip("RGB", (0.6, y, 0.64), strict=True):
            np.testing.assert_allclose(exact[name], value, atol=1e-6)
        codes = imagecodecs.png_decode((tmp_path / "normals.png").read_bytes())
        np.testing.assert_allclose(
            codes / 65535 * 2 - 1, np.full((*SIZE, 3), (0.6, y, 0.64)), atol=1e-4
        )
