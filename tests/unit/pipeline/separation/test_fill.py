from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.light.model import Model
from pipeline.pair.reduced import reduce_pair
from pipeline.separation.fill import Surroundings
from pipeline.separation.proportions import model_proportions


@pytest.fixture
def surroundings(
    exact: Callable[..., tuple[Any, Floats64]],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> tuple[Surroundings, Floats32]:
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
    surroundings: tuple[Surroundings, Floats32],
) -> None:
    around, true = surroundings

    found = around.rows(slice(0, 64), 96)

    assert found.shape == (2, 64, 96, 3)
    np.testing.assert_allclose(found.sum(axis=0), 1, atol=1e-4)
    hole = (slice(None), slice(20, 40), slice(30, 60))
    assert np.abs(found[hole] - true[hole]).mean() < 0.1
    assert found[0, 30, 32, 1] > found[0, 30, 57, 1] + 0.2


def test_surroundings_reach_the_full_size_of_a_reduced_pair(
    exact: Callable[..., tuple[Any, Floats64]],
    pair_of: Callable[..., Any],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
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
    warm_to_cool: Floats64,
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


def test_blocks_have_the_proportions_of_their_middle(
    surroundings: tuple[Surroundings, Floats32],
) -> None:
    around, true = surroundings

    found = around.blocks()

    np.testing.assert_array_equal(found, around.rows(slice(0, 64), 96))
    assert np.abs(found - true)[:, :18].max() < 0.02


def test_a_noisy_block_tells_less_of_what_fills_a_hole_beside_it(
    pair_of: Callable[..., Any],
    model: Model,
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> None:
    """Half of each lamp's light everywhere, but one block at the rim seems to be warm alone."""
    lamps = lamps_of(warm_to_cool[[0, 2]])
    part = np.tile(0.4 * model.flash_white, (32, 32, 1)).astype(np.float32)
    warm, cool = (part @ matrix.T for matrix in lamps.matrices)
    no_flash = (warm + cool) / 2
    no_flash[15, 11] = warm[0, 0]
    clipped = np.zeros((32, 32), bool)
    clipped[12:20, 12:20] = True
    quiet = reduce_pair(pair_of(no_flash, part, unusable=clipped))
    variance = quiet.flash_variance.copy()
    variance[15, 11] = np.square(quiet.flash[15, 11] * lamps.least_sine)
    noisy = replace(quiet, flash_variance=variance)

    true = model_proportions((warm + cool).astype(np.float32), part, lamps)
    off, less = (
        np.abs(Surroundings(one, lamps).blocks() - true)[:, 12:20, 12:20] for one in (quiet, noisy)
    )

    assert off.max() > 0.04
    # of four blocks it is averaged with, it is a quarter, and a seventh where it counts for half
    np.testing.assert_allclose(less, off * 4 / 7, atol=1e-4)
    np.testing.assert_allclose(Surroundings(noisy, lamps).blocks().sum(axis=0), 1, atol=1e-6)


def test_the_shadow_of_the_flash_on_a_wall_is_lit_like_the_wall(
    pair_of: Callable[..., Any],
    model: Model,
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> None:
    """A thing in cool light throws it, right beside itself, on a wall in warm light."""
    lamps = lamps_of(warm_to_cool[[0, 2]])
    whole = np.tile(0.5 * model.flash_white, (32, 64, 1))
    no_flash = whole @ lamps.matrices[0].T
    no_flash[:, 40:] = (whole @ lamps.matrices[1].T)[:, 40:]
    part = whole.copy()
    part[:, 34:40] = 0.0

    found = Surroundings(reduce_pair(pair_of(no_flash, part)), lamps).blocks()

    np.testing.assert_allclose(found[0, :, :40], 1, atol=0.05)
    np.testing.assert_allclose(found[0, :, 40:], 0, atol=1e-4)
