from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.spaces import (
    ADOBE_RGB_PRIMARIES,
    REC2020_PRIMARIES,
    SRGB_PRIMARIES,
    XYZ_TO_SRGB,
    adaptation,
    adapts,
    rgb_to_xyz,
)
from pipeline.spectra.lights import find_light
from pipeline.spectra.observer import cie_1931


def test_the_matrix_of_srgb_is_that_of_the_standard() -> None:
    """IEC 61966-2-1, table of 4 decimals."""
    expected = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    np.testing.assert_allclose(rgb_to_xyz(SRGB_PRIMARIES), expected, atol=1e-4)


def test_the_matrix_of_rec2020_is_that_of_the_standard() -> None:
    """Rec. ITU-R BT.2020, luminance weights, and BT.2087, table of 4 decimals."""
    expected = [[0.6370, 0.1446, 0.1689], [0.2627, 0.6780, 0.0593], [0.0000, 0.0281, 1.0610]]
    np.testing.assert_allclose(rgb_to_xyz(REC2020_PRIMARIES), expected, atol=1e-4)


def test_the_matrix_of_adobe_rgb_is_that_of_the_standard() -> None:
    """Adobe RGB (1998), 4.3.5.3, table of 5 decimals."""
    expected = [
        [0.57667, 0.18556, 0.18823],
        [0.29734, 0.62736, 0.07529],
        [0.02703, 0.07069, 0.99134],
    ]
    np.testing.assert_allclose(rgb_to_xyz(ADOBE_RGB_PRIMARIES), expected, atol=5e-5)


def test_white_of_srgb_is_d65() -> None:
    white = cie_1931() @ find_light("D65")
    rgb = XYZ_TO_SRGB @ (white / white[1])
    np.testing.assert_allclose(rgb, 1.0, atol=0.002)


def test_white_is_the_sum_of_the_primaries() -> None:
    white = rgb_to_xyz(SRGB_PRIMARIES, (0.3457, 0.3585)).sum(axis=1)

    np.testing.assert_allclose(white, [0.3457 / 0.3585, 1, (1 - 0.3457 - 0.3585) / 0.3585])


def test_adaptation_from_d65_to_d50_is_the_published_one() -> None:
    """Lindbloom's table of Bradford matrices, 7 decimals."""
    d65, d50 = np.array([0.95047, 1.0, 1.08883]), np.array([0.96422, 1.0, 0.82521])
    expected = [
        [1.0478112, 0.0228866, -0.0501270],
        [0.0295424, 0.9904844, -0.0170491],
        [-0.0092345, 0.0150436, 0.7521316],
    ]
    np.testing.assert_allclose(adaptation(d65, d50), expected, atol=1e-6)


def of_cones(*cones: float) -> Floats64:
    """CIE XYZ of a light that these cones see of it, by Bradford's matrix as it was published."""
    bradford = [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
    return np.asarray(np.linalg.solve(bradford, cones), np.float64)


@pytest.mark.parametrize(("blue", "can"), [(0.021, True), (0.019, False), (-0.3, False)])
def test_a_white_that_lacks_a_cones_light_is_taken_for_one_with_a_fiftieth(
    blue: float, can: bool
) -> None:
    white, other = of_cones(0.5, 1.0, blue), of_cones(0.8, 0.9, 1.0)

    assert adapts(white) is can
    found = adaptation(white, other) @ of_cones(0.25, 0.5, 0.01)
    np.testing.assert_allclose(found, of_cones(0.4, 0.45, 0.01 / max(blue, 0.02)), atol=1e-9)


def test_a_white_with_less_than_nothing_for_a_cone_leaves_it_nothing() -> None:
    found = adaptation(of_cones(1.0, 1.0, 1.0), of_cones(0.8, 0.9, -0.1)) @ of_cones(1, 1, 1)

    np.testing.assert_allclose(found, of_cones(0.8, 0.9, 0.0), atol=1e-9)
