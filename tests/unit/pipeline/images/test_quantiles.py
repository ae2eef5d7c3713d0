from __future__ import annotations

import numpy as np
import pytest

from pipeline.images.quantiles import quantile, weighted_quantile


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.85, 0.99, 1.0])
@pytest.mark.parametrize("size", [1, 2, 7, 1000, (30, 41, 3)])
def test_quantiles_are_those_of_numpy(size: int | tuple[int, ...], share: float) -> None:
    values = np.random.default_rng(1).normal(size=size).astype(np.float32)

    assert quantile(values, share) == pytest.approx(float(np.quantile(values, share)), rel=1e-5)


def test_equal_values_and_views_have_quantiles_and_stay_as_they_are() -> None:
    values = np.array([[3.0, 1.0, 3.0], [3.0, 2.0, 3.0]], np.float32)

    assert quantile(values, 0.5) == 3.0
    assert quantile(values[:, 1], 0.5) == 1.5
    np.testing.assert_array_equal(values, [[3, 1, 3], [3, 2, 3]])


def test_nothing_has_no_quantile() -> None:
    with pytest.raises(IndexError):
        quantile(np.empty(0, np.float32), 0.5)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.85, 1.0])
@pytest.mark.parametrize("size", [1, 2, 7, 81, 20000])
def test_weighted_quantiles_are_those_of_the_sorted_values(size: int, share: float) -> None:
    random = np.random.default_rng(size)
    values = random.normal(size=size).astype(np.float32)
    weights = random.uniform(0.1, 3.0, size).astype(np.float32)
    order = np.argsort(values)
    ladder = np.cumsum(weights[order], dtype=np.float64)
    first = min(int(np.searchsorted(ladder, share * ladder[-1])), size - 1)

    found = weighted_quantile(values, weights, share)

    place = int(np.flatnonzero(values[order] == np.float32(found))[0])
    assert abs(place - first) <= size // 10000  # sums of many weights are rounded


def test_weighted_quantiles_of_equal_values_and_of_ones_far_apart() -> None:
    weights = np.array([1.0, 1.0, 5.0], np.float32)

    assert weighted_quantile(np.full(3, 0.25, np.float32), weights, 0.5) == 0.25
    assert weighted_quantile(np.array([1e30, -1e-30, 2.0], np.float32), weights, 0.5) == 2.0
    assert np.isnan(weighted_quantile(np.array([1.0, np.nan, 2.0], np.float32), weights, 0.5))
