from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.calibration.flash_doubts import flash_doubts
from pipeline.calibration.flash_spectrum import FlashEstimate, estimate_flash
from pipeline.calibration.patches import Patches
from pipeline.spectra.cameras import Camera, named_camera
from pipeline.spectra.colorchecker import colorchecker_spectra
from pipeline.spectra.lights import find_light
from tests.targets import other_colorchecker
from tests.unit.pipeline.calibration.photographs import frame_of

NIKON, SIGMA = named_camera("Nikon D5100"), named_camera("Sigma SD1 Merrill")
EXIF: dict[str, Any] = {"make": "NIKON CORPORATION", "model": "NIKON D5100", "encoding": "raw"}
OTHER: dict[str, Any] = {**EXIF, "make": "Canon", "model": "EOS 5D"}  # measured nowhere
X, Y = np.meshgrid(np.linspace(-1, 1, 6), np.linspace(-0.6, 0.6, 4))
PLACES = np.stack([X.ravel(), Y.ravel()], axis=1)


def _chart(sensitivities: Floats64 = NIKON.sensitivities) -> Patches:
    """Of another make than the known one."""
    lit = other_colorchecker() @ (sensitivities * find_light("LED-B4")).T
    return Patches(lit, (0.005 * lit) ** 2, colorchecker_spectra(), PLACES)


def _said(patches: Patches, camera: Camera, exif: dict[str, Any]) -> list[str]:
    flash = estimate_flash(patches, camera.sensitivities)
    return [
        warning.code.value for warning in flash_doubts(flash, patches, camera, frame_of(**exif))
    ]


def _shifted(nm: int) -> Camera:
    """Another camera, which sees longer waves."""
    return Camera("other", np.roll(NIKON.sensitivities, nm // 5, axis=1), "file")


@pytest.mark.parametrize("exif", [EXIF, OTHER])
def test_the_right_camera_is_no_doubt(exif: dict[str, Any]) -> None:
    assert _said(_chart(), NIKON, exif) == []


def test_a_camera_that_the_files_do_not_name_is_told_where_theirs_explains_more() -> None:
    patches = _chart()
    named = _shifted(5)
    flash = estimate_flash(patches, named.sensitivities)
    assert flash.misfit < 0.04  # as right ones leave
    (warning,) = flash_doubts(flash, patches, named, frame_of(**EXIF))
    assert warning.code == "camera_doubtful"
    assert warning.message.startswith(
        "The Nikon D5100, which the files name, explains the chart far better than the camera that "
        "was named, whose error goes to the flash and to all colours: leave --camera out"
    )


def test_what_is_named_stands_where_the_camera_of_the_files_explains_less() -> None:
    """As a table of the very body, or a camera behind a lens that tints."""
    assert _said(_chart(SIGMA.sensitivities), SIGMA, EXIF) == []


@pytest.mark.parametrize(("off", "told"), [(0.054, []), (0.056, ["flash_doubtful"])])
def test_a_chart_that_is_explained_worse_than_other_makes_is_told(
    off: float, told: list[str]
) -> None:
    flash = FlashEstimate(find_light("xenon"), "xenon", off)
    patches = replace(_chart(), variance=np.full((24, 3), 1e-12))
    said = flash_doubts(flash, patches, NIKON, frame_of(**OTHER))
    assert [warning.code.value for warning in said] == told
    for warning in said:
        assert warning.figures == {"misfit": off}
        assert "The flash explains the patches to 5.6% only" in warning.message
        assert "check the camera and the marks, keep gloss and shadows off" in warning.message


def test_noise_does_not_speak_against_a_flash() -> None:
    chart = _chart()
    noisy = replace(chart, variance=(0.08 * chart.flash) ** 2)
    flash = FlashEstimate(find_light("xenon"), "xenon", 0.08)
    assert flash_doubts(flash, noisy, NIKON, frame_of(**OTHER)) == []
    assert len(flash_doubts(flash, chart, NIKON, frame_of(**OTHER))) == 1


def test_a_wrong_camera_is_told_by_the_chart_alone() -> None:
    assert _said(_chart(), _shifted(15), OTHER) == ["flash_doubtful"]


def test_of_guesses_the_chart_says_no_more() -> None:
    """They are told already."""
    patches, guess = _chart(), replace(_shifted(15), source="approximate")
    assert _said(patches, guess, OTHER) == []
    assert _said(patches, _shifted(15), {**OTHER, "encoding": "srgb"}) == []


@pytest.mark.parametrize(("off", "told"), [(0.019, 0), (0.021, 1)])
def test_a_card_is_told_by_its_light_alone(off: float, told: int) -> None:
    seen = (NIKON.sensitivities @ find_light("xenon"))[None]
    card = Patches(seen, np.full(seen.shape, 1e-12), np.ones((1, 81)), np.zeros((1, 2)))
    flash = FlashEstimate(find_light("xenon"), "xenon", off)
    said = flash_doubts(flash, card, SIGMA, frame_of(**EXIF))
    assert [warning.code.value for warning in said] == ["flash_doubtful"] * told
