"""What cannot be done is said: codes and figures in the manifest, a sentence on the screen."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.spectra.cameras import typical_sensor
from pipeline.spectra.colorimetry import camera_to_xyz
from pipeline.spectra.lights import find_light, reflectance_spectra
from tests.acceptance.conftest import float_tiff

FLAGS = ("--camera", "Nikon D5100", "--no-align", "--lights", 2, "--exposure-ratio", 1)
OTHER = "Sigma SD1 Merrill"
GAIN, READ = 1 / 20_000, 5 / 20_000

Photograph = Callable[..., tuple[Path, Path]]


@pytest.fixture
def photograph(scene: Callable[..., Any], tmp_path: Path) -> Photograph:
    """Take two lamps anew, with a sensor's noise: so much flash, and light where it is wanted."""

    def take(flash: float = 1.0, where: NDArray[np.bool_] | None = None) -> tuple[Path, Path]:
        truth = scene(2).truth
        random = np.random.default_rng(5)
        lit = np.ones(truth.flash.shape[:2]) if where is None else where
        light = truth.layers.sum(0) * lit[..., None]
        both = light + flash * truth.flash * lit[..., None]
        paths = tmp_path / "a.tif", tmp_path / "b.tif"
        for path, values in zip(paths, (light, both), strict=True):
            noise = np.sqrt(np.maximum(values, 0) * GAIN + READ**2)
            noisy = values + noise * random.standard_normal(values.shape)
            path.write_bytes(float_tiff(noisy.clip(0, 1)))
        return paths

    return take


def warning(manifest: dict[str, Any], code: str) -> dict[str, Any]:
    """The one warning of a code."""
    (found,) = [one for one in manifest["warnings"] if one["code"] == code]
    return dict(found)


def test_a_weak_flash_is_told_with_the_stops_it_lacks(
    photograph: Photograph, command: Callable[..., Any]
) -> None:
    """Twice the flash lacks one stop less."""
    weak, less_weak = (command(photograph(flash), *FLAGS) for flash in (1 / 60, 1 / 30))

    told, told_less = (
        warning(run.results.manifest, "flash_too_weak")["figures"] for run in (weak, less_weak)
    )
    assert 1 > told["share"] > told_less["share"] > 0.1
    assert told["usable_share"] == pytest.approx(1 - told["share"], abs=1e-3)
    assert told["stops"] - told_less["stops"] == pytest.approx(1, abs=0.25)
    assert "Warning: The flash is too weak in " in weak.stdout


def test_objects_before_black_lack_no_flash(
    photograph: Photograph, command: Callable[..., Any]
) -> None:
    """Most of the picture is filled in, and none of it had any light."""
    run = command(photograph(where=np.indices((240, 360))[0] > 150), *FLAGS)

    assert run.code == 0, run.stderr
    assert run.results.manifest["filled"] > 0.5
    assert not {"flash_too_weak", "clipped"} & set(run.results.warnings())


@pytest.mark.parametrize(("files", "lights"), [("dng", 2), ("exact", 3)])
def test_another_camera_than_the_one_that_took_the_pair_is_told(
    scene: Callable[..., Any], command: Callable[..., Any], files: str, lights: int
) -> None:
    pair = getattr(scene(lights), files)
    flags = ("--no-align", "--lights", lights, "--exposure-ratio", 1, "--outputs", "gamma.png")

    right, wrong = (command(pair, *flags, "--camera", camera) for camera in ("Nikon D5100", OTHER))

    assert "camera_doubtful" not in right.results.warnings()
    assert "camera_doubtful" in wrong.results.warnings()
    assert "A typical sensor explains the photographs much better" in wrong.stdout


@pytest.mark.parametrize("by", ["option", "EXIF"])
def test_a_converter_that_made_linear_srgb_is_told(
    scene: Callable[..., Any], command: Callable[..., Any], tmp_path: Path, by: str
) -> None:
    """A camera that EXIF names is not taken for the sensor's values; one that is named is."""
    truth = scene(3).truth
    sensor = typical_sensor().sensitivities
    to_xyz = camera_to_xyz(sensor, find_light("D65"), reflectance_spectra())
    matrix = XYZ_TO_SRGB @ to_xyz
    light = truth.layers.sum(0) @ matrix.T
    both = light + truth.flash @ matrix.T
    paths = tmp_path / "a.tif", tmp_path / "b.tif"
    tags = [(271, 2, 0, "NIKON", True), (272, 2, 0, "Nikon D5100", True)] if by == "EXIF" else []
    for path, values in zip(paths, (light, both), strict=True):
        data = (0.9 * values / both.max()).astype(np.float32)
        tifffile.imwrite(path, data, photometric="rgb", metadata=None, extratags=tags)
    named = ("--camera", "Nikon D5100") if by == "option" else ()
    flags = ("--no-align", "--lights", 3, "--exposure-ratio", 1, "--outputs", "gamma.png")

    run = command(paths, *flags, *named)

    if by == "option":
        assert run.results.manifest["camera"]["name"] == "Nikon D5100"
        assert "like linear sRGB" in warning(run.results.manifest, "camera_doubtful")["message"]
    else:
        assert run.results.manifest["camera"]["name"] == "sRGB"
        said = warning(run.results.manifest, "camera_approximate")["message"]
        assert "do not hold what the sensor of the Nikon D5100 gives" in said
        assert "camera_doubtful" not in run.results.warnings()
