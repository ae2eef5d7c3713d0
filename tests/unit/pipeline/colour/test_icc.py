"""Our profiles in the eyes of other people's colour management."""

from __future__ import annotations

import io
from typing import Any

import imagecodecs
import numpy as np
import pytest
from PIL import ImageCms

from pipeline.arrays import Floats64
from pipeline.colour.icc import (
    adobe_rgb_profile,
    linear_rec2020_profile,
    matrix_profile,
    srgb_profile,
)
from pipeline.colour.spaces import (
    ADOBE_RGB_PRIMARIES,
    D65_XY,
    REC2020_PRIMARIES,
    SRGB_PRIMARIES,
    Primaries,
)

REFERENCE_SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
EQUAL_XY = (1 / 3, 1 / 3)


def colorants(profile: Any) -> Floats64:
    """XYZ (3, 3) of red, green and blue, adapted to D50, in rows."""
    found = (profile.red_colorant, profile.green_colorant, profile.blue_colorant)
    return np.array([colorant[0] for colorant in found if colorant is not None])


@pytest.mark.parametrize("profile", [srgb_profile(), linear_rec2020_profile()])
def test_profiles_are_valid_and_say_their_own_length(profile: bytes) -> None:
    imagecodecs.cms_profile_validate(profile)
    assert int.from_bytes(profile[:4], "big") == len(profile)
    assert profile[36:40] == b"acsp"
    assert len(profile) % 4 == 0


def test_srgb_is_what_little_cms_calls_srgb() -> None:
    codes = np.random.default_rng(1).integers(0, 256, (50, 50, 3), dtype=np.uint8)

    through = imagecodecs.cms_transform(
        codes, srgb_profile(), REFERENCE_SRGB, colorspace="rgb", outcolorspace="rgb"
    )

    assert np.abs(through.astype(int) - codes).max() <= 1


@pytest.mark.parametrize(
    ("profile", "white", "primaries"),
    [
        (linear_rec2020_profile(), D65_XY, REC2020_PRIMARIES),
        (adobe_rgb_profile(), D65_XY, ADOBE_RGB_PRIMARIES),
        (matrix_profile("E", SRGB_PRIMARIES, "srgb", EQUAL_XY), EQUAL_XY, SRGB_PRIMARIES),
    ],
)
def test_profiles_have_the_primaries_and_the_white_they_are_of(
    profile: bytes, white: tuple[float, float], primaries: Primaries
) -> None:
    """The xy of the colorants and of their sum, adapted back from D50."""
    found = ImageCms.ImageCmsProfile(io.BytesIO(profile)).profile
    assert found.chromatic_adaptation is not None
    xyz = np.linalg.solve(np.array(found.chromatic_adaptation[0]), colorants(found).T).T

    for one, xy in zip([*xyz, xyz.sum(axis=0)], [*primaries, white], strict=True):
        np.testing.assert_allclose(one[:2] / one.sum(), xy, atol=5e-4)


def test_the_curve_of_adobe_rgb_is_its_power() -> None:
    """Adobe RGB (1998), 4.3.4.2: 2 + 51/256, as a profile holds it to the bit."""
    assert b"curv" + bytes(4) + b"\0\0\0\1" + bytes((2, 51)) in adobe_rgb_profile()


def test_white_is_exactly_the_connection_spaces() -> None:
    for data in (srgb_profile(), linear_rec2020_profile()):
        profile = ImageCms.ImageCmsProfile(io.BytesIO(data)).profile
        np.testing.assert_allclose(colorants(profile).sum(0), (0.9642, 1.0, 0.8249), atol=2e-5)


def test_equal_requests_give_equal_bytes() -> None:
    primaries = ((0.64, 0.33), (0.3, 0.6), (0.15, 0.06))
    assert matrix_profile("x", primaries, "srgb") == matrix_profile("x", primaries, "srgb")
    assert matrix_profile("x", primaries, "srgb") != matrix_profile("x", primaries, "linear")


def test_a_name_must_be_ascii() -> None:
    with pytest.raises(UnicodeEncodeError):
        matrix_profile("λ", ((0.64, 0.33), (0.3, 0.6), (0.15, 0.06)), "srgb")
