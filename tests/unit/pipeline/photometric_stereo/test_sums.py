from __future__ import annotations

import numpy as np

from pipeline.photometric_stereo.sums import Sums

CORNERS = np.array([[0, 1, 2, 3], [1, 4, 3, 5]])
WHICH = np.array([[0, 2], [2, 1]])
SHARE = np.array([[0.75, 0.25], [0.9, 0.1]])
SUMS = Sums(CORNERS, WHICH, SHARE, 6, 3)
AT_CORNERS = np.arange(16.0).reshape(2, 4, 2)
OF_PIXELS = np.array([[1.0, -2.0], [10.0, 4.0]])


def test_corners_sum_what_the_pixels_around_them_have() -> None:
    expected = np.zeros((6, 2))
    for pixel, corners in enumerate(CORNERS):
        for place, corner in enumerate(corners):
            expected[corner] += AT_CORNERS[pixel, place]

    np.testing.assert_allclose(SUMS.at_corners(AT_CORNERS), expected)


def test_materials_sum_what_their_pixels_have_by_its_weight() -> None:
    found = SUMS.of_materials(OF_PIXELS)

    np.testing.assert_allclose(found, [[0.75, -1.5], [1.0, 0.4], [9.25, 3.1]])
    np.testing.assert_allclose(SUMS.of_materials(OF_PIXELS[:, :, None])[..., 0], found)


def test_corners_of_a_material_sum_by_its_weight() -> None:
    expected = np.zeros((6, 3, 2))
    for pixel, corners in enumerate(CORNERS):
        for place, corner in enumerate(corners):
            for material, weight in zip(WHICH[pixel], SHARE[pixel], strict=True):
                expected[corner, material] += weight * AT_CORNERS[pixel, place]

    np.testing.assert_allclose(SUMS.at_corners_of_materials(AT_CORNERS), expected)


def test_pairs_of_materials_sum_by_both_weights() -> None:
    expected = np.zeros((3, 3, 2))
    for pixel in range(2):
        weights = np.zeros(3)
        weights[WHICH[pixel]] = SHARE[pixel]
        expected += weights[:, None, None] * weights[:, None] * OF_PIXELS[pixel]

    np.testing.assert_allclose(SUMS.of_pairs(OF_PIXELS), expected)
