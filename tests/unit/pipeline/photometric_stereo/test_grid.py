from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.photometric_stereo.grid import carried, make_grid


def corners_of(plane: tuple[float, float, float], size: int, focal_px: float) -> Any:
    """Squared depths (size + 1, size + 1) at the corners of pixels of a plane n·P = −1."""
    y, x = np.mgrid[: size + 1, : size + 1] - size / 2
    across, up = x / focal_px, -y / focal_px
    return (-1 / (plane[0] * across + plane[1] * up - plane[2])) ** 2


@pytest.mark.parametrize("plane", [(0.0, 0.0, 1.0), (0.3, 0.0, 1.0), (-0.2, 0.5, 0.8)])
def test_w_is_the_normal_by_distance_and_foreshortening(plane: tuple[float, float, float]) -> None:
    """Of a plane, whose normal is known at every pixel: w = n D²/(n·v)."""
    size, focal = 20, 400.0
    middle = size / 2 - 0.5
    grid = make_grid(np.ones((size, size), bool), focal, (middle, middle))
    normal = np.array(plane) / np.linalg.norm(plane)
    y, x = np.mgrid[:size, :size] - middle
    ray = np.stack([x / focal, -y / focal, -np.ones_like(x)], axis=-1).reshape(-1, 3)
    place = ray * (-1 / (ray @ np.array(plane)))[:, None]
    distance = np.linalg.norm(place, axis=1)
    facing = -(place @ normal) / distance

    found = grid.w(grid.at(corners_of(plane, size, focal)))

    expected = normal * (distance**2 / facing)[:, None]
    np.testing.assert_allclose(found, expected, rtol=2e-4, atol=2e-4 * np.abs(expected).max())


def test_corners_are_shared_by_neighbours_and_none_lies_beyond_the_mask() -> None:
    mask = np.array([[True, True, False], [False, True, False]])

    grid = make_grid(mask, 10.0, (1.0, 0.5))

    assert grid.corners.shape == (3, 4)
    assert int(grid.corner_mask.sum()) == grid.corners.max() + 1 == 8
    assert not grid.corner_mask[:, 3].any()
    np.testing.assert_array_equal(grid.corners[0, [1, 3]], grid.corners[1, [0, 2]])


def test_bends_are_changes_of_slope() -> None:
    """h = x²: 2 in every row, ½ f times, and none along columns."""
    mask = np.ones((3, 4), bool)
    grid = make_grid(mask, 6.0, (1.5, 1.0))
    h = np.broadcast_to(np.arange(5.0) ** 2, (4, 5))

    bends = grid.bends(grid.at(h))

    np.testing.assert_allclose(sorted(bends), [0.0] * 10 + [6.0] * 12)


def test_bends_do_not_reach_across_gaps() -> None:
    mask = np.zeros((1, 8), bool)
    mask[0, :3] = mask[0, 5:] = True

    grid = make_grid(mask, 1.0, (3.5, 0.0))

    assert grid.bent.shape == (8, 3)  # two bends in each of two rows on each side


def test_the_inflated_start_is_nearest_in_the_middle(ball: Callable[..., Any]) -> None:
    one = ball()
    grid = one.grid

    inflated, flat = grid.inflated(), grid.flat()

    assert (flat == 1).all()
    assert inflated.max() < 1
    middle = grid.corners[np.flatnonzero(one.inside.ravel()[one.inside.ravel()])[0]]
    assert inflated[middle].mean() > inflated.min()
    assert inflated.min() == pytest.approx((7 / 8) ** 2, rel=0.01)


def test_bends_do_not_reach_across_a_cut_one_pixel_wide() -> None:
    """Corners on both sides of it are neighbours, and the surface may jump between them."""
    mask = np.ones((3, 5), bool)
    mask[:, 2] = False
    grid = make_grid(mask, 6.0, (2.0, 1.0))
    h = np.where(np.arange(6) < 3, 1.0, 5.0) * np.ones((4, 1))

    np.testing.assert_array_equal(grid.bends(grid.at(h)), 0)


def test_squared_depths_are_carried_to_another_grid() -> None:
    """To a finer one between corners; beyond the old grid as at its nearest corner."""
    mask = np.zeros((4, 6), bool)
    mask[1:3, 1:4] = True
    old = make_grid(mask, 10.0, (2.5, 1.5))
    y, x = np.nonzero(old.corner_mask)
    new = make_grid(np.ones((4, 6), bool), 10.0, (2.5, 1.5))
    finer = make_grid(np.kron(mask, np.ones((2, 2))) > 0, 20.0, (5.5, 3.5))

    beyond = np.zeros(new.corner_mask.shape)
    beyond[new.corner_mask] = carried(1.0 + x + 10.0 * y, old, new)
    between = np.zeros(finer.corner_mask.shape)
    between[finer.corner_mask] = carried(1.0 + x + 10.0 * y, old, finer, 0.5)

    assert beyond[2, 3] == 24
    assert beyond[2, 6] == 25
    assert beyond[4, 0] == 32
    assert between[3, 5] == pytest.approx(1 + 2.5 + 15)
