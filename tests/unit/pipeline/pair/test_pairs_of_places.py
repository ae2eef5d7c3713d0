from __future__ import annotations

import numpy as np
import pytest

from pipeline.pair.pairs_of_places import Places


def test_the_height_is_that_of_a_bell_above_a_wider_one_where_light_is_left() -> None:
    """Of three pairs two differ by .03 and by .2 in red, and of one the change leaves nothing."""
    flash = np.full((2, 3, 3), 0.5)
    flash[1, :2, 0] *= np.exp((0.03, 0.2))
    light = np.zeros((1, 2, 3, 3))
    light[0, :, 2] = 1.0

    height = Places(flash, light).height(np.array([0.48]))

    bells = [
        np.exp(-0.5 * (off / 0.03) ** 2) - (0.03 / 0.08) ** 2 * np.exp(-0.5 * (off / 0.08) ** 2)
        for off in (0.03, 0.2)
    ]
    np.testing.assert_allclose(height, 100 / 3 * sum(bells))


@pytest.mark.parametrize(("change", "real"), [(0.47, True), (0.48, False)])
def test_a_twentieth_of_the_flash_part_must_be_left(change: float, real: bool) -> None:
    flash, light = np.full((2, 1, 3), 0.5), np.ones((1, 2, 1, 3))

    left, whether = Places(flash, light).without(np.array([change]))

    np.testing.assert_allclose(left, max(0.5 - change, 0.025))
    assert whether == [real]


@pytest.mark.parametrize("change", [-1.0, -0.3, 0.5])
def test_light_that_makes_all_colours_more_or_less_alike_gains_nothing(change: float) -> None:
    """The lamp's colour is the flash's own, and red differs by .03."""
    flash = np.full((2, 1, 3), 0.5)
    flash[1, 0, 0] *= np.exp(0.03)
    places, steady = Places(flash, np.full((1, 2, 1, 3), 0.2)), np.zeros(1)

    found = places.gain(np.array([change]), steady)

    assert found < 0.1
    higher = places.height(np.array([change])) - places.height(steady)
    assert higher < -14 if change > 0 else higher > 6


def test_a_gain_is_of_the_height_where_light_is_taken_off() -> None:
    """A lamp's red is half of the flash part's in one place."""
    flash = np.full((2, 1, 3), 0.5)
    flash[1, 0, 0] = 1.0
    light = np.zeros((1, 2, 1, 3))
    light[0, 1, 0, 0] = 1.0
    places = Places(flash, light)

    found = places.gain(np.array([0.49]), np.zeros(1))

    expected = places.height(np.array([0.49])) - places.height(np.zeros(1))
    assert expected > 50
    np.testing.assert_allclose(found, expected)
