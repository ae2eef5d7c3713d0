from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.hui2018.three_lights import minimum_triangle, three_lights
from pipeline.vectors import unit
from tests.unit.pipeline.hui2018.known_lights import COOL, LIGHTS, WARM, worst_angle


def area(corners: Floats64) -> float:
    a, b = corners[1] - corners[0], corners[2] - corners[0]
    return float(abs(a[0] * b[1] - a[1] * b[0])) / 2


def least_area(points: Floats64, steps: int = 120) -> float:
    """Area of the least enclosing triangle among those with sides in so many directions."""
    angles = np.arange(steps) * 2 * np.pi / steps
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    supports = (points @ normals.T).max(axis=0)
    best = np.inf
    for chosen in combinations(range(steps), 3):
        gaps = np.diff([*angles[list(chosen)], angles[chosen[0]] + 2 * np.pi])
        if gaps.max() >= np.pi - 1e-9:
            continue  # open to one side
        n, h = normals[list(chosen)], supports[list(chosen)]
        corners = np.array(
            [np.linalg.solve(n[[i, j]], h[[i, j]]) for i, j in ((0, 1), (1, 2), (2, 0))]
        )
        best = min(best, area(corners))
    return best


def test_a_square_has_a_triangle_of_twice_its_area() -> None:
    """Known: the least triangle around a parallelogram has twice its area."""
    square = np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]])

    assert area(minimum_triangle(square)) == pytest.approx(0.08, rel=1e-3)


def test_a_triangle_is_its_own() -> None:
    corners = np.array([[-0.3, -0.1], [0.25, -0.2], [0.05, 0.4]])
    inside = np.random.default_rng(1).dirichlet(np.ones(3), 200) @ corners

    found = minimum_triangle(np.concatenate([inside, corners]))

    for corner in corners:
        assert np.linalg.norm(found - corner, axis=1).min() < 2e-4


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_other_triangle_is_smaller(seed: int) -> None:
    """Against every triangle with sides in 40 directions."""
    points = np.random.default_rng(seed).normal(0, 0.1, (30, 2))

    found = minimum_triangle(points)

    assert area(found) <= least_area(points, 40) * 1.001
    edges = np.roll(found, -1, axis=0) - found
    side = np.sign(edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0])
    for corner, edge in zip(found, edges, strict=True):
        offset = points - corner
        assert (side * (edge[0] * offset[:, 1] - edge[1] * offset[:, 0]) > -1e-4).all()


def test_three_lights_are_the_corners_of_their_mixtures() -> None:
    mixed = unit(np.random.default_rng(2).dirichlet(np.ones(3), 2000) @ LIGHTS)

    found = three_lights(np.concatenate([mixed, LIGHTS]))

    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    assert worst_angle(found, LIGHTS) < 0.05


def test_the_triangle_holds_every_mixture() -> None:
    gammas = unit(np.random.default_rng(3).dirichlet(2 * np.ones(3), 2000) @ LIGHTS)

    found = three_lights(gammas)

    assert np.linalg.solve(found.T, gammas.T).min() > -2e-3


def test_a_single_outlier_moves_a_corner() -> None:
    """As published: the triangle obeys every point that pruning has left."""
    mixed = unit(np.random.default_rng(2).dirichlet(np.ones(3), 2000) @ LIGHTS)
    outlier = unit(np.array([0.95, 0.3, 0.1]))

    found = three_lights(np.concatenate([mixed, LIGHTS, outlier[None]]))

    assert np.linalg.solve(found.T, outlier).min() > -2e-3
    assert worst_angle(found, LIGHTS) > 5


def test_equal_invariants_are_one_light_three_times() -> None:
    found = three_lights(np.repeat(WARM[None], 50, axis=0))

    np.testing.assert_allclose(found, [WARM] * 3, atol=1e-4)


def test_two_points_are_the_ends_and_the_middle_between() -> None:
    found = three_lights(np.array([WARM, COOL]))

    middle = unit(WARM + COOL)
    np.testing.assert_allclose(found[1], middle, atol=1e-3)
    assert worst_angle(found, np.array([WARM, COOL])) < 0.01


def test_mixtures_of_two_lights_give_three_on_their_arc_that_hold_it() -> None:
    """What is left of the triangle is as thin as the grid of the plane."""
    found = three_lights(unit(np.linspace(0, 1, 40)[:, None] * (COOL - WARM) + WARM))

    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    assert np.abs(found @ unit(np.cross(WARM, COOL))).max() < 2e-3
    along = found @ unit(COOL - WARM)
    assert along.min() < WARM @ unit(COOL - WARM) + 1e-3
    assert along.max() > COOL @ unit(COOL - WARM) - 1e-3


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_points_than_corners_stay_finite(count: int) -> None:
    found = three_lights(LIGHTS[:count])

    assert found.shape == (3, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)


def test_invariants_behind_the_pole_have_no_corner() -> None:
    mixed = unit(np.random.default_rng(2).dirichlet(np.ones(3), 500) @ LIGHTS)
    behind = np.repeat(-unit(LIGHTS.mean(axis=0))[None], 5, axis=0)

    found = three_lights(np.concatenate([mixed, LIGHTS, behind]))

    assert worst_angle(found, LIGHTS) < 0.05
