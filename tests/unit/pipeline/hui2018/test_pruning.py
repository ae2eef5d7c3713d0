from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.hui2018.pruning import prune
from pipeline.vectors import unit

POLE = np.array([0.0, 0.0, 1.0])


def at(x: float, y: float) -> Floats64:
    """Unit vector with these components beside the pole."""
    return np.array([x, y, np.sqrt(1 - x * x - y * y)])


def balanced(*groups: tuple[float, float, int]) -> Floats64:
    """So many vectors at (x, y) and as many at (−x, −y), so that their mean is at the pole."""
    return np.concatenate(
        [np.repeat([at(sign * x, sign * y)], n, axis=0) for x, y, n in groups for sign in (1, -1)]
    )


def test_bins_above_the_cutoff_stay_and_no_others() -> None:
    """8,120 in 40,000 bins are .2 on average, so T = 1: one in a bin goes, two stay."""
    gammas = balanced((0.105, 0.105, 2000), (0.205, 0.0, 2000), (0.305, 0.1, 2), (0.405, 0.2, 1))

    kept = prune(gammas)

    np.testing.assert_array_equal(
        kept, balanced(*[(0.105, 0.105, 2000), (0.205, 0.0, 2000)], (0.305, 0.1, 2))
    )


def test_the_cutoff_is_the_mean_count_of_all_bins() -> None:
    """120,000 in 40,000 bins are 3 on average: three in a bin go, four stay."""
    rest = 60_000 - 3 - 4
    gammas = balanced((0.105, 0.105, rest), (0.305, 0.1, 3), (0.405, 0.2, 4))

    kept = prune(gammas)

    assert len(kept) == len(gammas) - 2 * 3
    assert {round(float(abs(x)), 3) for x in kept[:, 0]} == {0.105, 0.405}


def test_bins_are_a_hundredth_wide() -> None:
    """Neighbours .004 apart share a bin and stay, .012 apart they do not and go."""
    dense = (0.105, 0.105, 500)
    together = balanced(dense, (0.3035, 0.2, 1), (0.3075, 0.2, 1))
    apart = balanced(dense, (0.3035, 0.2, 1), (0.3155, 0.2, 1))

    assert len(prune(together)) == 1004
    assert len(prune(apart)) == 1000


def test_the_order_is_kept_and_the_direction_does_not_matter() -> None:
    rng = np.random.default_rng(3)
    flat = np.concatenate([rng.normal(0, 0.02, (3000, 2)), rng.uniform(-0.5, 0.5, (40, 2))])
    gammas = unit(np.column_stack([flat, np.ones(len(flat))]))

    kept = prune(gammas)

    where = [int(np.flatnonzero((gammas == one).all(axis=1))[0]) for one in kept]
    assert where == sorted(where)
    assert 2500 < sum(i < 3000 for i in where) < 3000
    assert sum(i >= 3000 for i in where) < 8


@pytest.mark.parametrize("behind", [-POLE, unit(np.array([0.3, 0.2, -1.0]))])
def test_invariants_behind_the_pole_go_even_where_there_are_many(behind: Floats64) -> None:
    gammas = np.concatenate([np.repeat([POLE], 900, axis=0), np.repeat([behind], 100, axis=0)])

    np.testing.assert_array_equal(prune(gammas), gammas[:900])


def test_equal_invariants_all_stay() -> None:
    gammas = np.repeat([at(0.6, 0.48)], 50, axis=0)

    np.testing.assert_array_equal(prune(gammas), gammas)


def test_of_scattered_invariants_nothing_is_left() -> None:
    """Each alone in its bin."""
    apart = np.arange(-8, 9) / 20
    gammas = np.array([at(x, y) for x in apart for y in apart])

    assert prune(gammas).shape == (0, 3)


def test_of_nothing_nothing_is_left() -> None:
    assert prune(np.empty((0, 3))).shape == (0, 3)
