from __future__ import annotations

import numpy as np
import pytest

from pipeline.matrixfit.mixture import Shape, log_densities

INSIDE = Shape(extension=0.0, outlier=1.5, spread=1.0)
ACROSS = Shape(extension=0.5, outlier=6.0, spread=1.5)


def at(points: list[tuple[float, float]], shape: Shape = INSIDE, sigma: float = 0.01) -> np.ndarray:
    """Densities (4, n) with corners at (0.2, 0.3) and (0.5, 0.4)."""
    corners = np.array([[[0.2, 0.3]], [[0.5, 0.4]]]).repeat(len(points), axis=1)
    return log_densities(np.array(points), corners, np.full(len(points), sigma), shape)[0]


def test_a_corner_is_a_normal_distribution() -> None:
    found = at([(0.2, 0.3), (0.21, 0.3)])

    np.testing.assert_allclose(found[0, 0], 1 / (2 * np.pi * 0.01**2))
    np.testing.assert_allclose(found[0, 1], np.exp(-0.5) * found[0, 0])


def test_the_line_is_even_between_its_ends_and_ends_there() -> None:
    quarter, middle, beyond = at([(0.275, 0.325), (0.35, 0.35), (0.59, 0.43)])[2]

    assert quarter == pytest.approx(middle, rel=1e-3)
    assert middle == pytest.approx(1 / (np.sqrt(2 * np.pi) * 0.01 * np.hypot(0.3, 0.1)), rel=1e-3)
    assert beyond < 1e-6 * middle


def test_lines_of_differences_reach_beyond_their_ends() -> None:
    middle, beyond, far = at([(0.35, 0.35), (0.6, 0.4333), (0.8, 0.5)], ACROSS)[2]

    assert beyond == pytest.approx(middle, rel=0.02)
    assert far < 1e-6 * middle


def test_densities_integrate_to_one() -> None:
    axis = np.linspace(-0.5, 1.2, 500)
    x, y = np.meshgrid(axis, axis)
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    corners = np.array([[[0.2, 0.3]], [[0.5, 0.4]]]).repeat(len(points), axis=1)

    for shape in (INSIDE, ACROSS):
        found = log_densities(points, corners, np.full(len(points), 0.02), shape)[0]
        np.testing.assert_allclose(found[:3].sum(axis=1) * (axis[1] - axis[0]) ** 2, 1, rtol=1e-3)


@pytest.mark.parametrize("shape", [INSIDE, ACROSS])
def test_gradients_are_those_of_differences(shape: Shape) -> None:
    rng = np.random.default_rng(3)
    u, sigma = rng.uniform(0.1, 0.6, (40, 2)), rng.uniform(0.02, 0.1, 40)
    corners = rng.uniform(0.1, 0.6, (2, 40, 2))
    densities, gradients = log_densities(u, corners, sigma, shape)

    for lamp in (0, 1):
        for axis in (0, 1):
            step = np.zeros_like(corners)
            step[lamp, :, axis] = 1e-6
            up, down = (
                np.log(log_densities(u, corners + sign * step, sigma, shape)[0]) for sign in (1, -1)
            )
            for part, gradient in enumerate(gradients):
                expected = gradient[lamp][:, axis] if lamp in gradient else np.zeros(40)
                strong = densities[part] > 1e-12
                np.testing.assert_allclose(
                    ((up - down) / 2e-6)[part][strong], expected[strong], rtol=1e-3, atol=1e-3
                )


def test_corners_at_one_place_are_no_error() -> None:
    corners = np.full((2, 3, 2), 0.3)
    densities, gradients = log_densities(
        np.array([[0.3, 0.3], [0.31, 0.3], [0.9, 0.1]]), corners, np.full(3, 0.01), INSIDE
    )

    assert np.isfinite(densities).all()
    assert all(np.isfinite(part).all() for one in gradients for part in one.values())
