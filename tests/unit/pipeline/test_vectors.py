from __future__ import annotations

import numpy as np

from pipeline.vectors import angles_deg, cross_2d, unit


def test_vectors_get_length_one_and_zero_stays_zero() -> None:
    found = unit(np.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, -2.0, 0.0]]))

    np.testing.assert_allclose(found, [[0.6, 0.0, 0.8], [0.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def test_a_single_vector_and_a_picture_of_them() -> None:
    np.testing.assert_allclose(unit(np.array([0.0, 5.0])), [0, 1])
    found = unit(np.full((2, 3, 4), np.float32(7)))

    assert found.dtype == np.float64
    np.testing.assert_allclose(found, np.full((2, 3, 4), 0.5), rtol=1e-6)


def test_angles_are_those_of_cosines_however_they_are_rounded() -> None:
    cosines = np.array([[1.0, 0.5], [0.0, -1.0], [1 + 1e-15, -1 - 1e-15]])

    np.testing.assert_allclose(angles_deg(cosines), [[0, 60], [90, 180], [0, 180]])


def test_areas_have_the_sign_of_the_turn() -> None:
    a, b = np.array([[1.0, 0.0], [2.0, 1.0]]), np.array([[0.5, 3.0], [4.0, 1.0]])

    np.testing.assert_allclose(cross_2d(a, b), [3, -2])
    np.testing.assert_allclose(cross_2d(b, a), [-3, 2])
