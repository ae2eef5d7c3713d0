"""The compiled passes against NumPy; the equations are held against their source in test_refine."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.pair.lucas_kanade import add_products, sampled, span

HEIGHT, WIDTH = 30, 40
MATRICES = {
    "still": np.eye(3),
    "shift": np.array([[1, 0, 3.4], [0, 1, -2.6], [0, 0, 1]]),
    "turn": np.array([[0.9137, -0.3721, 5.33], [0.3721, 0.9137, -6.17], [0, 0, 1]]),
    "tilt": np.array([[1.1, 0.05, -2], [0.02, 0.95, 1], [2e-3, -3e-3, 1]]),
    "away": np.array([[1, 0, 90.0], [0, 1, 0], [0, 0, 1]]),
}


def in_both(matrix: Floats64, margin: int, inset: int) -> NDArray[np.bool_]:
    """Pixels (h, w) that span is to give, row by row."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    u, v, depth = (row[0] * x + row[1] * y + row[2] for row in matrix)
    u, v = u / depth, v / depth
    inside = (u >= inset) & (u <= WIDTH - 1 - inset) & (v >= inset) & (v <= HEIGHT - 1 - inset)
    inside &= (x >= margin) & (x < WIDTH - margin)
    return np.asarray(inside)


@pytest.mark.parametrize("kind", MATRICES)
@pytest.mark.parametrize(("margin", "inset"), [(0, 0), (0, 1), (6, 3)])
def test_spans_are_the_pixels_that_lie_in_both(kind: str, margin: int, inset: int) -> None:
    matrix = MATRICES[kind]
    expected = in_both(matrix, margin, inset)

    for y in range(HEIGHT):
        start, end = span(matrix, y, (WIDTH, HEIGHT), margin, inset)

        found = np.zeros(WIDTH, bool)
        found[start:end] = True
        np.testing.assert_array_equal(found, expected[y])


def drawn() -> tuple[Floats32, Floats32]:
    one, other = np.random.default_rng(2).normal(size=(2, HEIGHT, 3 * WIDTH)).astype(np.float32)
    return one, other


@pytest.mark.parametrize("step", [1, 3])
def test_gradients_and_differences_of_some_rows(step: int) -> None:
    one, other = drawn()
    matrix = MATRICES["turn"]

    strengths, differences = sampled(one, other, matrix, 6, 3, step)

    used = in_both(matrix, 6, 3)
    used[:6] = used[-6:] = False
    used[np.arange(HEIGHT) % step != 6 % step] = False
    both = (0.5 * (one + other)).reshape(HEIGHT, WIDTH, 3)
    x, y = (cv2.Sobel(both, -1, 1 - axis, axis, scale=0.125) for axis in (0, 1))
    np.testing.assert_allclose(strengths, (x * x + y * y)[used].T, rtol=1e-4, atol=1e-6)
    np.testing.assert_array_equal(differences, (one - other).reshape(both.shape)[used].T)


@pytest.mark.parametrize("kind", MATRICES)
@pytest.mark.parametrize("columns", [1, 3])
def test_products_are_sums_over_what_lies_in_both(kind: str, columns: int) -> None:
    one, other = drawn()
    inside = np.repeat(in_both(MATRICES[kind], 0, 1), 3, axis=1)
    sums = np.ones((columns, 3))

    add_products(one, other, MATRICES[kind], 0, len(one), 1, sums)

    for column, found in enumerate(sums):
        left, right = (3 * (edge * WIDTH // columns) for edge in (column, column + 1))
        own = np.zeros_like(inside)
        own[:, left:right] = inside[:, left:right]
        expected = [(a * b)[own].sum() for a, b in ((one, one), (other, other), (one, other))]
        np.testing.assert_allclose(found, np.add(expected, 1.0), rtol=1e-4, atol=1e-3)
