from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.fill import Surroundings, push_pull
from pipeline.model import Model
from pipeline.proportions import model_proportions
from pipeline.reduced import reduce_pair

Array = NDArray[np.float64]


def picture(height: int, width: int) -> NDArray[np.float32]:
    rng = np.random.default_rng(6)
    return rng.uniform(0.2, 0.8, (height, width, 2)).astype(np.float32)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (2, 2), (13, 21), (64, 48)])
def test_what_is_known_is_left_alone(size: tuple[int, int]) -> None:
    values = picture(*size)
    weight = (np.random.default_rng(1).uniform(size=size) > 0.6).astype(np.float32)
    weight[0, 0] = 1.0

    found = push_pull(values, weight)

    assert found.shape == values.shape
    np.testing.assert_array_equal(found[weight == 1], values[weight == 1])


@pytest.mark.parametrize("size", [(2, 2), (13, 21), (64, 48)])
def test_gaps_lie_between_what_is_known(size: tuple[int, int]) -> None:
    values = picture(*size)
    weight = (np.random.default_rng(1).uniform(size=size) > 0.8).astype(np.float32)
    weight[0, 0] = 1.0
    values[weight == 0] = 99.0

    found = push_pull(values, weight)

    known = values[weight == 1]
    assert (found >= known.min(axis=0) - 1e-5).all()
    assert (found <= known.max(axis=0) + 1e-5).all()


def test_a_gap_in_an_even_picture_disappears() -> None:
    weight = np.ones((40, 60), np.float32)
    weight[5:35, 7:50] = 0
    values = weight[..., None] * np.array([0.25, 0.75], np.float32)

    np.testing.assert_allclose(push_pull(values, weight), np.tile([0.25, 0.75], (40, 60, 1)), 1e-5)


def test_a_gap_between_two_sides_takes_from_the_nearer_one() -> None:
    values = np.zeros((32, 64, 1), np.float32)
    values[:, 48:] = 1.0
    weight = np.zeros((32, 64), np.float32)
    weight[:, :16] = weight[:, 48:] = 1.0

    found = push_pull(values, weight)[16, :, 0]

    assert found[18] < 0.25
    assert found[45] > 0.75
    assert np.diff(found[16:48]).min() > -0.05


def test_one_known_pixel_speaks_for_its_neighbours() -> None:
    values, weight = np.zeros((32, 32, 1), np.float32), np.zeros((32, 32), np.float32)
    weight[:, :4] = weight[16, 16] = 1.0
    values[16, 16] = 1.0

    assert push_pull(values, weight)[15:18, 15:18].min() > 0.4


def test_half_known_pixels_are_blended() -> None:
    values = np.full((16, 16, 1), 0.2, np.float32)
    values[8, 8] = 1.0
    weight = np.ones((16, 16), np.float32)
    weight[8, 8] = 0.5

    assert 0.55 < push_pull(values, weight)[8, 8, 0] < 0.75


def test_nothing_known_gives_something_finite() -> None:
    found = push_pull(picture(9, 5), np.zeros((9, 5), np.float32))

    assert np.isfinite(found).all()


@pytest.fixture
def surroundings(
    exact: Callable[..., tuple[Any, Array]],
    lamps_of: Callable[..., Any],
    warm_to_cool: Array,
) -> tuple[Surroundings, NDArray[np.float32]]:
    """Surroundings of a pair with a clipped hole, and the true proportions of its lamps."""
    clipped = np.zeros((64, 96), bool)
    clipped[20:40, 30:60] = True
    lamps = lamps_of(warm_to_cool[[0, 2]])
    pair, layers = exact(warm_to_cool[[0, 2]], unusable=clipped)
    whole, _ = exact(warm_to_cool[[0, 2]])
    assert len(layers) == 2
    true = model_proportions(whole.no_flash, whole.flash - whole.no_flash, lamps)
    return Surroundings(reduce_pair(pair), lamps), true


def test_surroundings_fill_a_hole_with_the_light_around_it(
    surroundings: tuple[Surroundings, NDArray[np.float32]],
) -> None:
    around, true = surroundings

    found = around.rows(slice(0, 64), 96)

    assert found.shape == (2, 64, 96, 3)
    np.testing.assert_allclose(found.sum(axis=0), 1, atol=1e-4)
    hole = (slice(None), slice(20, 40), slice(30, 60))
    assert np.abs(found[hole] - true[hole]).mean() < 0.1
    assert found[0, 30, 32, 1] > found[0, 30, 57, 1] + 0.2


def test_surroundings_do_not_depend_on_the_rows_asked_for(
    surroundings: tuple[Surroundings, NDArray[np.float32]],
) -> None:
    around, _ = surroundings

    whole = around.rows(slice(0, 64), 96)

    cut = [around.rows(slice(top, min(top + 7, 64)), 96) for top in range(0, 64, 7)]
    np.testing.assert_array_equal(np.concatenate(cut, axis=1), whole)


def test_surroundings_reach_the_full_size_of_a_reduced_pair(
    exact: Callable[..., tuple[Any, Array]],
    pair_of: Callable[..., Any],
    lamps_of: Callable[..., Any],
    warm_to_cool: Array,
) -> None:
    """1030 pixels are reduced by three, so that the last column belongs to no block."""
    small, _ = exact(warm_to_cool[[0, 2]])
    part = small.flash - small.no_flash
    wide = [np.tile(picture, (1, 11, 1))[:31, :1030] for picture in (small.no_flash, part)]
    reduced = reduce_pair(pair_of(*wide))
    assert reduced.block == 3

    found = Surroundings(reduced, lamps_of(warm_to_cool[[0, 2]])).rows(slice(28, 31), 1030)

    assert found.shape == (2, 3, 1030, 3)
    np.testing.assert_allclose(found.sum(axis=0), 1, atol=1e-4)


def test_surroundings_of_a_reduced_pair_lie_where_they_belong(
    pair_of: Callable[..., Any],
    model: Model,
    lamps_of: Callable[..., Any],
    warm_to_cool: Array,
) -> None:
    """Warm light left of column 516, cool light right of it, blocks of three pixels."""
    lamps = lamps_of(warm_to_cool[[0, 2]])
    part = np.tile(0.5 * model.flash_white, (30, 1032, 1))
    warm = np.arange(1032) < 516
    no_flash = np.where(warm[:, None], part @ lamps.matrices[0].T, part @ lamps.matrices[1].T)

    found = Surroundings(reduce_pair(pair_of(no_flash, part)), lamps).rows(slice(0, 30), 1032)

    across = found[0, 15, :, 1]
    np.testing.assert_allclose(across[:514], 1, atol=1e-4)
    np.testing.assert_allclose(across[518:], 0, atol=1e-4)
    np.testing.assert_allclose(across[514:518], [1, 2 / 3, 1 / 3, 0], atol=1e-3)
