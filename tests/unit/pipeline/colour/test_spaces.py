from __future__ import annotations

import numpy as np

from pipeline.colour.spaces import REC2020_PRIMARIES, SRGB_PRIMARIES, XYZ_TO_SRGB, rgb_to_xyz
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


def test_white_of_srgb_is_d65() -> None:
    white = cie_1931() @ find_light("D65")
    rgb = XYZ_TO_SRGB @ (white / white[1])
    np.testing.assert_allclose(rgb, 1.0, atol=0.002)


def test_white_is_the_sum_of_the_primaries() -> None:
    white = rgb_to_xyz(SRGB_PRIMARIES, (0.3457, 0.3585)).sum(axis=1)

    np.testing.assert_allclose(white, [0.3457 / 0.3585, 1, (1 - 0.3457 - 0.3585) / 0.3585])
