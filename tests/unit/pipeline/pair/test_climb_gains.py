from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.pair.climb_gains import MOST_GAIN, climb_gains


@pytest.mark.parametrize("peak", [(0.31, -0.22), (-0.4, -0.1), (0.0, 0.0)])
def test_a_peak_is_climbed_to_within_the_last_step(peak: tuple[float, float]) -> None:
    def height(logs: Floats64) -> float:
        return 5.0 - float(np.square(logs - peak).sum())

    logs, most = climb_gains(height, np.zeros(2), 0.1, 0.003)

    np.testing.assert_allclose(logs, peak, atol=0.003)
    assert most == height(logs)


def test_beyond_the_largest_gain_nothing_is_looked_for() -> None:
    logs, most = climb_gains(lambda logs: float(logs[0] - logs[1]), np.zeros(2), 0.1, 0.003)

    np.testing.assert_allclose(logs, (MOST_GAIN, -MOST_GAIN))
    assert most == pytest.approx(2 * MOST_GAIN)


def test_where_all_is_alike_the_start_stays() -> None:
    logs, most = climb_gains(lambda _: 1.0, np.array([0.1, -0.2]), 0.1, 0.003)

    np.testing.assert_array_equal(logs, (0.1, -0.2))
    assert most == 1.0
