from __future__ import annotations

import numpy as np
import pytest

from tests.evaluation.baselines.shades_of_grey import shades_of_grey

NEUTRAL = np.array([0.6, 1.0, 0.8])


@pytest.mark.parametrize("power", [1.0, 6.0])
def test_a_grey_scene_becomes_that_of_the_neutral_light(power: float) -> None:
    grey = np.random.default_rng(1).uniform(0.1, 0.9, (8, 10, 1))
    photograph = (grey * [0.9, 0.5, 0.2]).astype(np.float32)

    found = shades_of_grey(photograph, 2 * NEUTRAL, power)

    np.testing.assert_allclose(found, 0.5 * grey * NEUTRAL, rtol=1e-5)


def test_a_high_power_listens_to_what_is_bright() -> None:
    photograph = np.full((10, 10, 3), [0.4, 0.2, 0.1], np.float32)
    photograph[0, 0] = 2.0  # a white highlight

    one, six = (shades_of_grey(photograph, np.ones(3), power)[0, 0] for power in (1.0, 6.0))

    assert np.ptp(six) < 0.1 < np.ptp(one)


def test_a_black_photograph_is_black() -> None:
    assert not shades_of_grey(np.zeros((4, 4, 3), np.float32), NEUTRAL, 6.0).any()
