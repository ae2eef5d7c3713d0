from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.hui2018.lamps import (
    from_plane,
    one_lamp,
    prune,
    three_lamps,
    to_plane,
    two_lamps,
    unit,
)

Array = NDArray[np.float64]

WARM, GREEN, COOL = unit(np.array([[0.7, 0.65, 0.3], [0.35, 0.9, 0.3], [0.3, 0.64, 0.71]]))
TOLERANCE = 0.04


def angle(a: Array, b: Array) -> float:
    """Angle in degrees."""
    return float(np.degrees(np.arccos(np.clip(unit(a) @ unit(b), -1, 1))))


def worst_angle(found: Array, corners: Array) -> float:
    """Largest angle in degrees between a corner and the found vector nearest to it."""
    return max(min(angle(corner, one) for one in found) for corner in corners)


def mixtures(corners: Array, count: int, scatter: float = 0.0, pure: float = 0.1) -> Array:
    """Unit mixtures (count, 3) of the corners, a share of them pure, scattered (radians)."""
    rng = np.random.default_rng(2)
    z = rng.uniform(0, 1, (count, len(corners)))
    alone = rng.uniform(size=count) < pure
    z[alone] = np.eye(len(corners))[rng.integers(0, len(corners), int(alone.sum()))]
    return unit(unit(z @ corners) + rng.normal(0, scatter, (count, 3)))


def outliers(count: int) -> Array:
    """Unit vectors (count, 3) anywhere on the sphere."""
    return unit(np.random.default_rng(9).normal(size=(count, 3)))


def test_unit_vectors_have_length_one_and_zero_stays_zero() -> None:
    found = unit(np.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0]]))

    np.testing.assert_allclose(found, np.array([[0.6, 0.0, 0.8], [0.0, 0.0, 0.0]]))


@pytest.mark.parametrize("center", [WARM, COOL, np.array([0.0, 1.0, 0.0]), np.array([0, 0.0, 2])])
def test_from_plane_inverts_to_plane(center: Array) -> None:
    rng = np.random.default_rng(4)
    gammas = unit(unit(center) + rng.normal(0, 0.2, (100, 3)))

    points, rotation = to_plane(gammas, center)

    assert points.shape == (100, 2)
    np.testing.assert_allclose(from_plane(points, rotation), gammas, atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation @ unit(center), [0, 0, 1], atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_the_projection_is_gnomonic() -> None:
    tilted = unit(np.array([[0.0, 0.0, 1.0], [np.tan(0.3), 0.0, 1.0]]))

    points, _ = to_plane(tilted, np.array([0.0, 0.0, 1.0]))

    np.testing.assert_allclose(np.linalg.norm(points, axis=1), [0, np.tan(0.3)], atol=1e-12)


def test_points_behind_the_pole_are_not_projected() -> None:
    points, _ = to_plane(np.array([WARM, -WARM, [0.65, -0.7, 0.0]]), WARM)

    np.testing.assert_allclose(points, [[0, 0]], atol=1e-12)


@pytest.mark.parametrize("fraction", [0.0, 0.03, 0.2])
def test_prune_drops_at_most_the_fraction(fraction: float) -> None:
    gammas = mixtures(np.array([WARM, COOL]), 3000, scatter=0.02)

    kept = prune(gammas, fraction)

    assert (1 - fraction) * len(gammas) <= len(kept) <= len(gammas)
    known = {tuple(row) for row in gammas}
    assert all(tuple(row) in known for row in kept)


def test_prune_drops_stray_points_first() -> None:
    cluster = mixtures(np.array([WARM]), 2000, scatter=0.005)
    stray = unit(WARM + np.array([[0.4, 0, 0], [0, 0.5, 0], [0, 0, 0.6], [0.2, 0, 0.5]]))

    kept = prune(np.vstack([cluster, stray]), 0.03)

    assert max(angle(one, WARM) for one in kept) < 5
    assert len(kept) >= 0.97 * 2004


def test_prune_drops_nothing_where_all_bins_are_full() -> None:
    gammas = np.repeat(np.array([WARM, COOL]), 500, axis=0)

    np.testing.assert_array_equal(prune(gammas, 0.03), gammas)


def test_one_lamp_is_found_among_outliers() -> None:
    reflections = mixtures(np.array([COOL]), 150, scatter=0.01)
    gammas = np.vstack([mixtures(np.array([GREEN]), 1000, scatter=0.01), outliers(50), reflections])

    found = one_lamp(gammas)

    assert found.shape == (1, 3)
    assert np.linalg.norm(found) == pytest.approx(1)
    assert angle(found[0], GREEN) < 1.5


def test_two_lamps_are_the_ends_of_the_arc() -> None:
    corners = np.array([WARM, COOL])

    found = two_lamps(mixtures(corners, 2000), TOLERANCE, tail=0.0)

    assert found.shape == (2, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    assert worst_angle(found, corners) < 0.01


@pytest.mark.parametrize("corners", [(WARM, COOL), (WARM, GREEN), (GREEN, COOL)])
def test_two_lamps_are_found_with_scatter_and_outliers(corners: tuple[Array, Array]) -> None:
    clean = mixtures(np.array(corners), 2000, scatter=0.008, pure=0.2)
    gammas = prune(np.vstack([clean, outliers(60)]), 0.03)

    found = two_lamps(gammas, TOLERANCE, tail=0.01)

    assert worst_angle(found, np.array(corners)) < 2


def test_a_clump_beside_the_arc_does_not_turn_the_line() -> None:
    """One light of another colour, in a fourth of the pixels."""
    corners = np.array([WARM, COOL])
    clump = mixtures(np.array([[0.2, 1.0, 0.1]]), 600, scatter=0.005)

    found = two_lamps(np.vstack([mixtures(corners, 2000), clump]), TOLERANCE, tail=0.0)

    assert worst_angle(found, corners) < 2.5


def test_the_tail_is_cut_from_both_ends() -> None:
    corners = np.array([WARM, COOL])
    gammas = mixtures(corners, 4000, pure=0.0)

    whole, cut = two_lamps(gammas, TOLERANCE, 0.0), two_lamps(gammas, TOLERANCE, 0.25)

    assert angle(*cut) < 0.75 * angle(*whole)
    assert min(angle(one, end) for one in cut for end in whole) > 0.1 * angle(*whole)


def test_two_lamps_are_the_same_every_time() -> None:
    gammas = mixtures(np.array([WARM, COOL]), 500, scatter=0.01)

    np.testing.assert_array_equal(two_lamps(gammas, 0.04, 0.01), two_lamps(gammas, 0.04, 0.01))


def test_two_lamps_of_a_single_point_are_that_point() -> None:
    found = two_lamps(np.repeat(WARM[None], 300, axis=0), TOLERANCE, 0.01)

    np.testing.assert_allclose(found, [WARM, WARM], atol=1e-9)


def test_three_lamps_are_the_corners_of_the_triangle() -> None:
    corners = np.array([WARM, GREEN, COOL])

    found = three_lamps(mixtures(corners, 3000))

    assert found.shape == (3, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    assert worst_angle(found, corners) < 0.1


def test_three_lamps_are_found_with_scatter_and_outliers() -> None:
    corners = np.array([WARM, GREEN, COOL])
    clean = mixtures(corners, 6000, scatter=0.003, pure=0.3)
    gammas = prune(np.vstack([clean, outliers(60)]), 0.03)

    assert worst_angle(three_lamps(gammas), corners) < 4


def test_the_triangle_holds_every_mixture() -> None:
    gammas = mixtures(np.array([WARM, GREEN, COOL]), 3000, pure=0.0)

    found = three_lamps(gammas)

    assert np.linalg.solve(found.T, gammas.T).min() > -2e-3


@pytest.mark.parametrize(
    "gammas",
    [
        np.repeat(WARM[None], 300, axis=0),
        np.repeat(WARM[None], 300, axis=0) + 1e-9 * np.arange(300)[:, None],
        np.repeat(np.array([WARM, COOL]), 200, axis=0),
    ],
    ids=["a point", "nearly a point", "two points"],
)
def test_three_lamps_without_a_triangle_stay_finite_and_near(gammas: Array) -> None:
    found = three_lamps(unit(gammas))

    assert found.shape == (3, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    assert min(angle(found[0], one) for one in gammas[::199]) < 35


def test_corners_far_outside_are_pulled_back() -> None:
    """A band of mixtures has an enclosing triangle whose far corner no light can have."""
    rng = np.random.default_rng(1)
    wide = np.column_stack(
        [rng.uniform(-0.05, 0.05, 2000), rng.uniform(-8, 8, 2000), np.ones(2000)]
    )

    gammas = unit(wide)

    found = three_lamps(gammas)

    assert max(angle(one, gammas.mean(axis=0)) for one in found) < 75.1
