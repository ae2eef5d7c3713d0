from __future__ import annotations

import numpy as np
import pytest

from pipeline.quantiles import quantile


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
