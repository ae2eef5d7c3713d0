from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.hui2018.two_lights import two_lights
from pipeline.vectors import unit
from tests.unit.pipeline.hui2018.known_lights import COOL, GREEN, WARM


def on_plane(*points: tuple[float, float]) -> Floats64:
    """Unit vectors that project to these points when (0, 0, 1) is the pole."""
    return unit(np.column_stack([np.array(points, dtype=float), np.ones(len(points))]))


def same(found: Floats64, expected: Floats64, atol: float) -> None:
    """Equal in one order or the other."""
    order = (
        slice(None)
        if np.abs(found - expected).max() < np.abs(found[::-1] - expected).max()
        else slice(None, None, -1)
    )
    np.testing.assert_allclose(found[order], expected, atol=atol)


def angle(a: Floats64, b: Floats64) -> float:
    """Angle in degrees."""
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


def test_a_line_has_its_end_points() -> None:
    x = np.linspace(-0.3, 0.3, 61)
    found = two_lights(on_plane(*((v, 0.5 * v) for v in x)))

    same(found, on_plane((-0.3, -0.15), (0.3, 0.15)), 1e-9)


@pytest.mark.parametrize("lights", [(WARM, COOL), (WARM, GREEN), (GREEN, COOL)])
def test_two_lights_are_the_ends_of_the_arc_of_their_mixtures(
    lights: tuple[Floats64, Floats64],
) -> None:
    t = np.random.default_rng(1).uniform(0, 1, (500, 1))
    mixed = np.concatenate([np.array(lights), unit(t * lights[0] + (1 - t) * lights[1])])

    same(two_lights(mixed), np.array(lights), 1e-6)


def test_outliers_off_the_line_do_not_count() -> None:
    """A third of the points lie elsewhere; the mean, and with it the plane, is where it was."""
    x = np.linspace(-0.3, 0.3, 200)
    rng = np.random.default_rng(2)
    away = rng.uniform(0.05, 0.4, (50, 2)) * rng.choice([-1, 1], (50, 1))
    gammas = on_plane(*((v, 0.0) for v in x), *map(tuple, away), *map(tuple, -away))

    found = two_lights(gammas)

    assert max(min(angle(end, one) for one in found) for end in on_plane((-0.3, 0), (0.3, 0))) < 0.4


def test_the_outermost_inliers_are_the_ends_with_no_share_cut_off() -> None:
    """A single point far out on the line moves the end: as published."""
    x = np.linspace(-0.2, 0.2, 2000)
    gammas = on_plane(*((v, 0.0) for v in x), (0.5, 0.0), (-0.5, 0.0))

    same(two_lights(gammas), on_plane((-0.5, 0), (0.5, 0)), 1e-9)


def test_inliers_lie_within_three_tenths_of_a_degree() -> None:
    """Beyond the ends, points .25° beside the line count; those 1° beside it do not."""
    x = np.linspace(-0.2, 0.2, 400)
    for degrees, reach in ((0.25, 0.3), (1.0, 0.2)):
        off = np.tan(np.radians(degrees))
        beyond = [(0.3, off), (0.3, -off), (-0.3, off), (-0.3, -off)]

        found = two_lights(on_plane(*((v, 0.0) for v in x), *beyond))

        assert np.abs(found[:, 0] / found[:, 2]).max() == pytest.approx(reach, abs=2e-3)


def test_the_lights_are_the_same_every_time() -> None:
    rng = np.random.default_rng(5)
    gammas = unit(
        WARM + rng.uniform(0, 1, (700, 1)) * (COOL - WARM) + rng.normal(0, 0.01, (700, 3))
    )

    np.testing.assert_array_equal(two_lights(gammas), two_lights(gammas))


@pytest.mark.parametrize("count", [1, 2, 300])
def test_equal_invariants_are_one_light_twice(count: int) -> None:
    found = two_lights(np.repeat(WARM[None], count, axis=0))

    np.testing.assert_allclose(found, [WARM, WARM], atol=1e-9)


def test_two_invariants_are_the_two_lights() -> None:
    same(two_lights(np.array([WARM, COOL])), np.array([WARM, COOL]), 1e-9)


def test_invariants_behind_the_pole_have_no_say() -> None:
    t = np.linspace(0, 1, 99)[:, None]
    mixed = unit(t * WARM + (1 - t) * COOL)
    behind = np.repeat(-unit(WARM + COOL)[None], 5, axis=0)

    same(two_lights(np.concatenate([mixed, behind])), np.array([COOL, WARM]), 1e-9)
