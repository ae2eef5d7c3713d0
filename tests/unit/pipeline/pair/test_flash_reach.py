from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.images.noise import Noise
from pipeline.pair.flash_reach import MOST_STOPS, NEEDED, FlashReach, flash_reach
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import reduce_pair

SIZE = (60, 100, 3)
DEVIATION = 0.002
"""Of the sum of three channels of the flash part, of which both photographs have their share."""


@pytest.fixture
def noisy_pair(pair_of: Callable[..., Any]) -> Callable[..., Pair]:
    """Make a pair of known noise of so much light and flash, without any noise in the values."""

    def build(no_flash: Any, part: Any, **more: Any) -> Pair:
        variance = DEVIATION**2 / (3 if more.get("flash_only") else 6)
        noise = Noise(np.zeros(3), np.full(3, variance))
        both = (np.broadcast_to(np.asarray(value, np.float32), SIZE) for value in (no_flash, part))
        pair: Pair = pair_of(*both, no_flash_noise=noise, flash_noise=noise, **more)
        return pair

    return build


def reach_of(pair: Pair) -> FlashReach:
    """With blocks as sure as those of a large picture."""
    reduced = reduce_pair(pair)
    return flash_reach(
        pair, replace(reduced, no_flash_variance=reduced.no_flash_variance * np.float32(0.01))
    )


@pytest.mark.parametrize("flash_only", [False, True])
@pytest.mark.parametrize("missing", [0.5, 1.0, 3.0])
def test_stops_are_what_the_flash_part_lacks(
    noisy_pair: Callable[..., Pair], missing: float, flash_only: bool
) -> None:
    part = NEEDED * DEVIATION / 3 / 2**missing

    reach = reach_of(noisy_pair(0.2, part, flash_only=flash_only))

    assert reach.weak == 1.0
    assert reach.stops == pytest.approx(missing, abs=0.02)


def test_a_pixel_needs_one_and_a_half_deviations_and_six_stops_are_the_most() -> None:
    assert (NEEDED, MOST_STOPS) == (1.5, 6.0)


def test_a_flash_that_is_there_needs_no_more(noisy_pair: Callable[..., Pair]) -> None:
    assert reach_of(noisy_pair(0.2, 1.05 * NEEDED * DEVIATION / 3)) == FlashReach(0.0, 0.0)


@pytest.mark.parametrize("part", [0.0, -0.001])
def test_a_flash_that_is_nowhere_is_the_most_stops_away(
    noisy_pair: Callable[..., Pair], part: float
) -> None:
    assert reach_of(noisy_pair(0.2, part)) == FlashReach(1.0, MOST_STOPS)


def test_what_the_lamps_light_counts_by_area(noisy_pair: Callable[..., Pair]) -> None:
    """The flash reaches three quarters; nine tenths of the light is beyond it."""
    part = np.full(SIZE, 0.1)
    part[:, 75:] = NEEDED * DEVIATION / 3 / 4

    reach = reach_of(noisy_pair(0.2, part))

    assert reach.weak == pytest.approx(0.25)
    assert reach.stops == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize("flash_only", [False, True])
def test_noise_of_light_counts_as_it_is_in_the_photograph_with_the_flash(
    pair_of: Callable[..., Any], flash_only: bool
) -> None:
    """Photons of lamps and flash both, where one photograph holds both; of its share alone else."""
    photons = Noise(np.full(3, 1e-4), np.full(3, 1e-12))
    light, part = (np.full(SIZE, value, np.float32) for value in (0.2, 0.001))
    pair = pair_of(light, part, no_flash_noise=photons, flash_noise=photons, flash_only=flash_only)

    variance = 3e-4 * (0.001 if flash_only else 0.2 + 0.2 + 0.001)
    expected = np.log2(max(1.5 * np.sqrt(variance) / 0.003, 1.0))
    assert reach_of(pair).stops == pytest.approx(expected, abs=0.01)
    assert reach_of(pair).weak == float(not flash_only)


@pytest.mark.parametrize(("behind", "weak"), [(0.0018, 0.1), (0.0022, 0.91)])
def test_what_is_darker_than_a_hundredth_does_not_count(
    noisy_pair: Callable[..., Pair], behind: float, weak: float
) -> None:
    """Of the 99th percentile, so that not of a glint; the darkness here is told from noise."""
    light, part = np.full(SIZE, behind), np.zeros(SIZE)
    light[20:40, 30:60], part[20:40, 30:60] = 0.2, 0.2
    part[20:40, 30:33] = 0.0
    light[20, 40:50], part[20, 40:50] = 0.9, 0.9
    pair = noisy_pair(light, part)
    reduced = reduce_pair(pair)
    sure = replace(reduced, no_flash_variance=np.full_like(reduced.no_flash_variance, 1e-9))

    assert flash_reach(pair, sure).weak == pytest.approx(weak, abs=0.01)


@pytest.mark.parametrize(("deviation", "weak"), [(0.1, 1.0), (0.2, 0.0)])
def test_light_that_is_not_told_from_noise_does_not_count(
    noisy_pair: Callable[..., Pair], deviation: float, weak: float
) -> None:
    """Blocks of 0.6 in all, of a deviation of a sixth of it and of a third."""
    pair = noisy_pair(0.2, 0.0)
    reduced = reduce_pair(pair)
    noisy = replace(
        reduced, no_flash_variance=np.full_like(reduced.no_flash_variance, deviation**2 / 3)
    )

    assert flash_reach(pair, noisy).weak == weak


def test_a_few_places_out_of_reach_ask_for_nothing(noisy_pair: Callable[..., Pair]) -> None:
    part = np.full(SIZE, 0.1)
    part[:, 95:] = 0.0

    reach = reach_of(noisy_pair(0.2, part))

    assert reach.weak == pytest.approx(0.05)
    assert reach.stops == 0.0


@pytest.mark.parametrize("background", [0.0, 0.0015])
def test_a_black_background_does_not_count(
    noisy_pair: Callable[..., Pair], background: float
) -> None:
    """An object before black: next to nothing of either light comes from behind it."""
    light, part = np.full(SIZE, background), np.zeros(SIZE)
    light[20:40, 30:60], part[20:40, 30:60] = 0.2, 0.2
    part[20:40, 30:33] = 0.0

    reach = reach_of(noisy_pair(light, part))

    assert reach.weak == pytest.approx(0.1)


def test_without_noise_any_flash_reaches(pair_of: Callable[..., Any]) -> None:
    none = Noise(np.zeros(3), np.zeros(3))
    light, part = (np.full(SIZE, value, np.float32) for value in (0.2, 1e-4))

    reach = reach_of(pair_of(light, part, no_flash_noise=none, flash_noise=none))

    assert reach == FlashReach(0.0, 0.0)


def test_black_pictures_lack_no_flash(noisy_pair: Callable[..., Pair]) -> None:
    assert reach_of(noisy_pair(0.0, 0.0)) == FlashReach(0.0, 0.0)
