from __future__ import annotations

import io
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image as PillowImage

from pipeline.arrays import Floats, Floats64
from pipeline.calibration.kept_calibrations import Kept
from pipeline.colour.curves import linear_to_srgb
from pipeline.colour.icc import linear_rec2020_profile
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.errors import (
    OptionError,
)
from pipeline.options import Options, Sensitivities, Spectrum
from pipeline.pair.relative_blur import RelativeBlur, blurred
from pipeline.process import separate_files
from pipeline.progress import Progress
from pipeline.run_warnings import Code, RunWarning
from pipeline.spectra.cameras import Camera, srgb_stand_in
from pipeline.spectra.tables import write_spectrum
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from pipeline.taken_with import TakenWith
from tests.layers import layers_of, picture, planes_of
from tests.unit.pipeline.separating import CAMERA, Files, codes, png, separated, tiff, turned


def test_rendered_files_are_warned_of(files: Callable[..., Files], tmp_path: Path) -> None:
    manifest = separated(files(write=png), tmp_path, camera=None, outputs=[])

    (warning,) = (w for w in manifest["warnings"] if w["code"] == "rendered_srgb")
    assert warning["message"].endswith(
        "Send RAW or linear files for exact work. Where the camera gives none, lock its white "
        "balance for both at flash or daylight, and choose a rendering without HDR, added contrast "
        "and strong colours."
    )
    assert manifest["camera"] == {"name": "sRGB", "source": "stand-in"}


def test_an_unknown_sensor_is_told_by_the_pair_and_warned_of(
    files: Callable[..., Files], tmp_path: Path
) -> None:
    manifest = separated(files(), tmp_path, camera=None, outputs=[])

    assert manifest["camera"] == {"name": "typical sensor", "source": "stand-in"}
    (warning,) = (w for w in manifest["warnings"] if w["code"] == "camera_approximate")
    assert "typical sensor explains the pair best and was taken" in warning["message"]
    assert "colours and temperatures of lamps and white-balanced pictures" in warning["message"]


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


@pytest.mark.parametrize(("setup", "told"), [("table", True), ("default", False)])
def test_a_set_up_that_was_named_and_has_nothing_kept_is_told_of(
    setup: str, told: bool, files: Callable[..., Files], tmp_path: Path
) -> None:
    manifest = separated(files(), tmp_path, setup=setup, outputs=[])

    assert ("nothing_kept" in codes(manifest)) is told


@pytest.mark.parametrize(("orientation", "told"), [(1, False), (3, True)])
def test_lamps_that_are_named_are_used_and_told_of_where_pictures_are_another_way_up(
    shaped: tuple[Files, dict[str, Any]], tmp_path: Path, orientation: int, told: bool
) -> None:
    """Half a turn inverts directions, and with them normals."""
    both, options = shaped
    taken_with = TakenWith(encoding="linear", upright=False, orientation=1)
    lights = [
        light.model_copy(update={"taken_with": taken_with}) for light in options["light_directions"]
    ]
    here = turned(both[0], orientation), turned(both[1], orientation)

    named = {**options, "light_directions": lights, "outputs": ["normals.png"]}
    manifest = separated(here, tmp_path, **named)

    assert manifest["normals"] is not None
    said = [one["message"] for one in manifest["warnings"] if one["code"] == "calibration_unfit"]
    assert len(said) == told
    assert all("(EXIF orientation 1, of these 3)" in message for message in said)
    of_options = manifest["options"]["light_directions"]
    assert [light["taken_with"]["orientation"] for light in of_options] == [1, 1, 1]


@pytest.mark.parametrize(("of", "told"), [("D5100", False), ("D850", True)])
def test_a_camera_that_is_named_is_used_and_told_of_where_it_is_another_ones(
    files: Callable[..., Files], camera: Camera, tmp_path: Path, of: str, told: bool
) -> None:
    r, g, b = camera.sensitivities.tolist()
    table = Sensitivities(
        wavelength_nm=WAVELENGTHS_NM.tolist(),
        r=r,
        g=g,
        b=b,
        taken_with=TakenWith(make="NIKON", model=of, encoding="linear"),
    )
    both = files(write=partial(tiff, camera=("NIKON", "D5100")))

    manifest = separated(both, tmp_path, camera=table, outputs=[])

    assert manifest["camera"] == {"name": "table", "source": "file"}
    assert ("calibration_unfit" in codes(manifest)) is told


def test_what_is_kept_and_fits_is_not_told_of(files: Callable[..., Files], tmp_path: Path) -> None:
    """It was held against the pair already, its own file's word is not asked again."""
    here = TakenWith(make="NIKON", model="D5100", encoding="linear")
    other = here.model_copy(update={"encoding": "srgb", "rendered": True})
    flash = Spectrum(wavelength_nm=[400, 700], power=[1, 1], taken_with=other)
    content = write_spectrum(flash).decode()
    kept = Kept(
        kind="flash", setup="default", name="a", made="2026", taken_with=here, content=content
    )
    both = files(write=partial(tiff, camera=("NIKON", "D5100")))

    manifest = separate_files(
        *both, Options(**CAMERA, outputs=[]), tmp_path, Progress(), kept=[kept]
    )

    assert [one["name"] for one in manifest["calibrations"]] == ["a"]
    assert "calibration_unfit" not in codes(manifest)


def test_layers_that_a_file_of_all_outputs_cannot_hold_are_passed_over(
    files: Callable[..., Files], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not refused after all has been estimated: nobody named layers.psd."""
    monkeypatch.setattr("pipeline.encode.psd_size._MOST_SIDE", 1)
    both = files()

    manifest = separated(both, tmp_path / "all", outputs="all")

    assert "output_left_out" in [warning["code"] for warning in manifest["warnings"]]
    names = [file["name"] for file in manifest["files"]]
    assert "layers.psd" not in names
    assert "layers.exr" in names
    with pytest.raises(OptionError, match=r"layers\.psd cannot hold .* leave it out"):
        separated(both, tmp_path / "named", outputs=["layers.psd"])


def rec2020(values: Floats) -> bytes:
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

    def doubt(*those: Any) -> list[RunWarning]:
        given.append(those)
        return [RunWarning(Code.CAMERA_DOUBTFUL, "Check the camera.")]

    monkeypatch.setattr("pipeline.process.camera_doubts", doubt)
    camera = "Sigma SD1 Merrill" if named else None

    manifest = separated(files(), tmp_path, lights=2, camera=camera, outputs=[])

    assert codes(manifest).count("camera_doubtful") == named
    assert [(lamps, camera.name) for _, lamps, camera, _, _ in given] == (
        [(2, "Sigma SD1 Merrill")] if named else []
    )


@pytest.mark.parametrize("taken", [False, True])
def test_of_linear_files_of_a_known_camera_the_pair_tells_whether_they_hold_its_values(
    files: Callable[..., Files], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, taken: bool
) -> None:
    sensors: list[Camera] = []

    def likely(*given: Any) -> Camera:
        sensors.append(given[3])
        return given[3] if taken else srgb_stand_in()

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
    monkeypatch.setattr(
        "pipeline.photometric_stereo.normals.find_facing", lambda *_: pytest.fail("looked")
    )

    manifest = separated(both, tmp_path, **{**lit, "focal_px": None}, outputs=["lamps.jpg"])

    assert manifest["normals"] is None
    assert "focal_length_assumed" not in codes(manifest)


def test_what_no_jpeg_holds_is_refused_before_the_work(
    files: Callable[..., Files], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.encode.jpeg._MOST_SIDE", 50)
    monkeypatch.setattr("pipeline.process.make_pair", lambda *_: pytest.fail("worked"))

    with pytest.raises(OptionError, match="A JPEG cannot hold 96 × 64 pixels"):
        separated(files(), tmp_path, outputs=["lamps.jpg"])


def test_what_was_filled_in_is_warned_of(
    exact: Callable[..., tuple[Any, Floats64]], warm_to_cool: Floats64, tmp_path: Path
) -> None:
    """The flash does not reach the lower half."""
    pair, _ = exact(warm_to_cool[[0, 2]])
    part = pair.flash - pair.no_flash
    part[32:] = 0

    manifest = separated((tiff(pair.no_flash), tiff(pair.no_flash + part)), tmp_path, outputs=[])

    assert manifest["filled"] == pytest.approx(0.5, abs=0.05)
    assert "flash_too_weak" in codes(manifest)


def test_a_photograph_on_a_scale_of_255_is_told_of(
    files: Callable[..., Files], tmp_path: Path
) -> None:
    """Only its layers.exr holds the layers: lampI.tif is white."""
    scaled = files(write=lambda values: tiff(255 * values))

    told = separated(scaled, tmp_path / "tiff", outputs=["lamps.tif"])
    silent = separated(scaled, tmp_path / "exr", outputs=["layers.exr"])

    assert "above_white" in codes(told)
    assert "above_white" not in codes(silent)
    assert "above_white" not in codes(separated(files(), tmp_path / "one"))


def test_a_screen_is_told_of_and_keeps_its_picture(
    exact: Callable[..., tuple[Any, Floats64]], warm_to_cool: Floats64, tmp_path: Path
) -> None:
    """Its left half is red, its right half blue, and the flash shows grey glass alone."""
    pair, _ = exact(warm_to_cool[[0, 2]])
    place = (slice(20, 40), slice(30, 66))
    shines = np.zeros((20, 36, 3), np.float32)
    shines[:, :18], shines[:, 18:] = (0.3, 0.03, 0.02), (0.02, 0.05, 0.4)
    shines *= np.linspace(0.9, 1.1, 20, dtype=np.float32)[:, None, None]  # else they end there
    light, part = pair.no_flash.copy(), pair.flash - pair.no_flash
    light[place], part[place] = shines, 0.1 * np.median(part, axis=(0, 1))
    names = ["confidence.tif", "white_balanced_1.tif"]

    manifest = separated((tiff(light), tiff(light + part)), tmp_path, outputs=names)

    assert "shines_itself" in codes(manifest)
    (warning,) = (w for w in manifest["warnings"] if w["code"] == "shines_itself")
    assert warning["figures"]["share"] == pytest.approx(22 * 38 / (64 * 96), abs=0.02)
    confidence = tifffile.imread(tmp_path / "confidence.tif")
    assert (confidence[place] == 0).all()
    assert np.median(confidence) > 0.9 * confidence.max()
    assert manifest["filled"] > 0.1
    balanced = tifffile.imread(tmp_path / "white_balanced_1.tif")[place]
    red, _, blue = np.moveaxis(balanced, 2, 0)
    assert (red[:, 2:16] > 2 * blue[:, 2:16]).all()
    assert (blue[:, 20:34] > 2 * red[:, 20:34]).all()


def test_a_flash_photograph_out_of_focus_leaves_results_as_sharp_as_the_photograph(
    exact: Callable[..., tuple[Any, Floats64]],
    warm_to_cool: Floats64,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair, _ = exact(warm_to_cool[[0, 2]])
    speckled = np.ones(pair.no_flash.shape, np.float32)
    speckled[::4, ::4] = 10.0  # beyond white where they are sharp alone
    sharp, flash = speckled * pair.no_flash, speckled * pair.flash
    blur = RelativeBlur(np.zeros((2, 2)), np.diag([2.0, 1.0]), np.zeros(2))
    monkeypatch.setattr("pipeline.pair.pair.find_relative_blur", lambda *_: blur)
    files = tiff(sharp), tiff(blurred(flash, blur.for_no_flash))
    wanted = ["layers.exr", "lamps.tif", "thumbnail.jpg"]

    manifest = separated(files, tmp_path, lights=2, outputs=wanted)

    assert "blurred" in codes(manifest)
    planes = planes_of((tmp_path / "layers.exr").read_bytes())
    np.testing.assert_allclose(picture(planes), sharp, atol=3e-3)
    np.testing.assert_allclose(layers_of(planes, 2).sum(axis=0), sharp, atol=3e-3)
    (above,) = (w for w in manifest["warnings"] if w["code"] == "above_white")
    assert above["figures"]["share"] == pytest.approx(np.mean(sharp.max(axis=2) > 1.0), abs=1e-3)
    to_xyz = np.array(manifest["mix"]["to_xyz"])
    white = np.quantile((sharp @ (XYZ_TO_SRGB @ to_xyz).T).max(axis=2), 0.995)
    assert white == pytest.approx(1.0, abs=0.01)
    shown = np.asarray(PillowImage.open(tmp_path / "thumbnail.jpg"), dtype=np.float64)
    as_shown = 255 * linear_to_srgb(np.clip(sharp @ (XYZ_TO_SRGB @ to_xyz).T, 0.0, 1.0))
    assert np.abs(shown - as_shown).mean() < 6.0
    assert np.abs(blurred(sharp, blur.for_no_flash) - sharp).max() > 0.5


def test_the_published_method_leaves_nothing_out(
    exact: Callable[..., tuple[Any, Floats64]], warm_to_cool: Floats64, tmp_path: Path
) -> None:
    pair, _ = exact(warm_to_cool[[0, 2]])
    light, part = pair.no_flash.copy(), pair.flash - pair.no_flash
    light[20:40, 30:66], part[20:40, 30:66] = (0.02, 0.05, 0.4), 0.02

    manifest = separated((tiff(light), tiff(light + part)), tmp_path, outputs=[], method="paper")

    assert "shines_itself" not in codes(manifest)
