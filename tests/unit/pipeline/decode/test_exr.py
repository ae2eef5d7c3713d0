"""What an OpenEXR says beside its pixels."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.decode import decode
from pipeline.errors import PairMismatchError, UnreadableImageError
from pipeline.images.frames import Exposure
from pipeline.pair.pair_checks import check_pair

SRGB = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)
P3_TO_SRGB = np.array([[1.2249, -0.2247, 0.0], [-0.0420, 1.0419, 0.0], [-0.0197, -0.0786, 1.0979]])
"""Linear Display P3 → linear sRGB; CSS Color Module 4, sample code."""
AP0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, 0.32168, 0.33767)
AP0_TO_SRGB = np.array(
    [[2.5217, -1.1341, -0.3876], [-0.2765, 1.3727, -0.0962], [-0.0154, -0.1530, 1.1684]]
)
"""ACES2065-1 → linear sRGB by Bradford, as published; white stays white."""


@pytest.fixture
def exr_file(tmp_path: Path) -> Callable[..., bytes]:
    def write(values: Floats32, **header: Any) -> bytes:
        path = tmp_path / "picture.exr"
        usual = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        channels = {name: values[..., i].copy() for i, name in enumerate("RGB")}
        OpenEXR.File({**usual, **header}, channels).write(str(path))
        return path.read_bytes()

    return write


@pytest.fixture
def light() -> Floats32:
    return np.random.default_rng(2).uniform(-0.1, 3.0, (12, 16, 3)).astype(np.float32)


@pytest.mark.parametrize(
    ("chromaticities", "to_srgb"),
    [(SRGB, np.eye(3)), (P3, P3_TO_SRGB), (AP0, AP0_TO_SRGB)],
    ids=["sRGB", "P3", "ACES"],
)
def test_chromaticities_become_those_of_srgb(
    exr_file: Callable[..., bytes],
    light: Floats32,
    chromaticities: tuple[float, ...],
    to_srgb: Floats64,
) -> None:
    frame = decode(exr_file(light, chromaticities=chromaticities))

    np.testing.assert_allclose(frame.pixels, light @ to_srgb.T, atol=0.004)
    assert (frame.encoding, frame.profiled) == ("linear", True)


@pytest.mark.parametrize(
    ("header", "encoding"),
    [
        ({}, "auto"),
        ({"chromaticities": P3}, "linear"),
        ({"chromaticities": (0.0,) * 8}, "auto"),
        ({"chromaticities": (*(0.3, 0.3) * 3, 0.3127, 0.329)}, "auto"),
        ({"chromaticities": (*P3[:6], 0.7, 0.2)}, "auto"),
        ({"chromaticities": (*P3[:6], float("nan"), 0.3)}, "auto"),
    ],
    ids=["nothing", "told", "zeros", "a point", "white outside", "no number"],
)
def test_values_stay_as_they_are_where_nothing_is_said_or_all_is_told(
    exr_file: Callable[..., bytes],
    light: Floats32,
    header: dict[str, Any],
    encoding: str,
) -> None:
    frame = decode(exr_file(light, **header), encoding)

    np.testing.assert_array_equal(frame.pixels, light)
    assert (frame.encoding, frame.profiled) == ("linear", False)


def test_the_exposure_is_read(exr_file: Callable[..., bytes], light: Floats32) -> None:
    data = exr_file(light, expTime=0.0125, isoSpeed=200.0, aperture=4.0)

    exposure = decode(data).exposure

    assert exposure.time_s == pytest.approx(0.0125)
    assert (exposure.iso, exposure.f_number) == (200, 4)
    assert decode(exr_file(light)).exposure == Exposure()


@pytest.mark.parametrize("opaque", [True, False])
def test_colours_that_a_transparency_has_darkened_are_refused(
    tmp_path: Path, light: Floats32, opaque: bool
) -> None:
    """OpenEXR multiplies colours by alpha; opaque ones are those of the light."""
    alpha = np.ones(light.shape[:2], np.float16)
    alpha[3, 5] = 1.0 if opaque else 0.999
    path = tmp_path / "picture.exr"
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGBA": np.dstack([light.astype(np.float16), alpha])}).write(str(path))

    if opaque:
        np.testing.assert_array_equal(decode(path.read_bytes()).pixels, light.astype(np.float16))
        return
    with pytest.raises(UnreadableImageError, match="is transparent in places, and its colours"):
        decode(path.read_bytes())


def window(x: int, y: int, width: int = 48, height: int = 36) -> tuple[Any, Any]:
    first = np.array([x, y], np.int32)
    return first, first + np.array([width - 1, height - 1], np.int32)


@pytest.mark.parametrize("place", [(20, 10), (0, 1), (-3, 0)])
def test_data_windows_at_different_places_are_no_pair(
    exr_file: Callable[..., bytes], place: tuple[int, int]
) -> None:
    light = np.random.default_rng(2).uniform(0, 1, (36, 48, 3)).astype(np.float32)
    shown = window(0, 0, 80, 60)
    no_flash = exr_file(light, dataWindow=window(0, 0), displayWindow=shown)
    aside = exr_file(2 * light, dataWindow=window(*place), displayWindow=shown)

    with pytest.raises(PairMismatchError) as caught:
        check_pair(no_flash, aside)
    assert f"data windows lie at different places, (0, 0) without the flash and {place}" in str(
        caught.value
    )


def test_data_windows_at_one_place_of_what_is_shown_are_a_pair(
    exr_file: Callable[..., bytes],
) -> None:
    light = np.random.default_rng(2).uniform(0, 1, (36, 48, 3)).astype(np.float32)
    no_flash = exr_file(light, dataWindow=window(5, 7), displayWindow=window(0, 0, 80, 60))
    flash = exr_file(2 * light, dataWindow=window(15, 27), displayWindow=window(10, 20, 80, 60))

    assert check_pair(no_flash, flash) == 1
