from __future__ import annotations

import numpy as np
import pytest

from pipeline.matrixfit.data import Data, draw, nothing, sandwich, upper


@pytest.mark.parametrize("count", [1, 7, 99, 100, 500])
def test_thinned_data_keep_their_weight(count: int) -> None:
    rng = np.random.default_rng(0)
    data = Data(
        rng.uniform(size=(100, 3)),
        rng.uniform(size=(100, 2)),
        rng.uniform(size=(100, 3)),
        rng.uniform(size=100),
    )

    found = data.thinned(count)

    assert len(found) == min(count, 100)
    assert found.weight.sum() == pytest.approx(data.weight.sum())
    assert {tuple(u) for u in found.u} <= {tuple(u) for u in data.u}


def test_nothing_has_no_data() -> None:
    assert len(nothing()) == len(nothing().thinned(5)) == 0
    assert nothing().weight.sum() == 0


def test_draws_follow_what_data_are_worth() -> None:
    worth = np.array([0.0, 3.0, 1.0, 0.0, 0.0, 4.0])

    np.testing.assert_array_equal(draw(worth, 6), np.arange(6))
    # rungs at 1, 3, 5, 7 of a ladder of 3, 4 and 8
    np.testing.assert_array_equal(draw(worth, 4), [1, 5])
    # and at 4/3, 4, 20/3
    np.testing.assert_array_equal(draw(worth, 3), [1, 2, 5])


def test_a_variance_between_matrices_is_a_product_of_matrices() -> None:
    rng = np.random.default_rng(3)
    left, right = rng.normal(size=(2, 5, 3, 3))
    variance = rng.uniform(size=(5, 3))

    found = sandwich(left, variance, right)

    expected = np.array(
        [a @ np.diag(v) @ b.T for a, v, b in zip(left, variance, right, strict=True)]
    )
    np.testing.assert_allclose(found, expected)
    np.testing.assert_array_equal(upper(found)[0], [found[0, 0, 0], found[0, 0, 1], found[0, 1, 1]])
