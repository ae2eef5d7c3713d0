"""Pairs of places of patches of paint, in the shadows of two lamps."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.images.frames import Mask
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.one_surface import Seen, average_pair, find_neighbours, taken_off
from pipeline.pair.tone_curve import NO_CONTRAST, ToneCurve
from tests.unit.pipeline.pair.shadows_on_paint import (
    SIZE,
    blocks,
    light_of,
    neighbours,
    neighbours_of,
    nothing,
    photographs,
    s_curve,
)

WIDTHS = 0.06, 0.15


def test_most_pairs_are_of_one_paint_and_the_peak_is_at_no_gains() -> None:
    seen = neighbours(photographs(s_curve(0.0), light_of())).through(NO_CONTRAST)

    high = seen.height(np.zeros(2), WIDTHS)

    assert high > 15
    for gains in ((0.2, 0.0), (0.0, -0.2), (-0.2, 0.2)):
        assert seen.height(np.array(gains), WIDTHS) < 0.6 * high


def test_through_a_contrast_that_is_left_the_peak_is_lower() -> None:
    plain, toned = (
        neighbours(photographs(s_curve(strength), light_of())).through(NO_CONTRAST)
        for strength in (0.0, 0.05)
    )

    assert toned.height(np.zeros(2), WIDTHS) < 0.6 * plain.height(np.zeros(2), WIDTHS)


def test_the_height_is_that_of_a_bell_above_a_wider_one() -> None:
    """Two pairs, of flash parts that differ by .1 and by 1 in red, and no noise."""
    without = np.full((2, 2, 3), 0.1)
    part = np.array([[0.2, 0.2, 0.2], [0.2, 0.2, 0.2]])
    other = part * [[np.exp(0.1), 1.0, 1.0], [np.e, 1.0, 1.0]]
    light = np.concatenate([without, (without[0] + part)[None], (without[1] + other)[None]])
    narrow, wide = WIDTHS

    height = Seen(light, np.zeros_like(light)).height(np.zeros(2), WIDTHS)

    bells = [
        np.exp(-0.5 * (off / narrow) ** 2) - (narrow / wide) ** 2 * np.exp(-0.5 * (off / wide) ** 2)
        for off in (0.1, 1.0)
    ]
    np.testing.assert_allclose(height, 50 * sum(bells), rtol=1e-9)


def test_gains_are_taken_off_the_flash_photograph() -> None:
    light = np.array([[[0.1, 0.1, 0.1]], [[0.1, 0.1, 0.1]], [[0.4, 0.3, 0.2]], [[0.8, 0.6, 0.4]]])
    gains = BalanceChange(1.25, 0.8).logs

    parts = Seen(light, np.full_like(light, 1e-4)).flash_parts(gains)

    np.testing.assert_allclose(taken_off(gains), (0.8, 1.0, 1.25))
    np.testing.assert_allclose(parts.light[:, 0], [[0.22, 0.2, 0.15], [0.54, 0.5, 0.4]])
    more = 1 + np.square(taken_off(gains))
    noise = sum((1e-4 * more / np.square(part[0])).sum() for part in parts.light)
    np.testing.assert_allclose(parts.noise, [noise])
    np.testing.assert_allclose(parts.weights(0.1), 1 / (1 + 75 * parts.noise))


def test_flash_parts_that_are_not_there_count_for_nothing() -> None:
    light = np.full((4, 1, 3), 0.2)

    seen = Seen(light, np.zeros_like(light))

    assert not seen.flash_parts(np.zeros(2)).known.any()
    assert seen.height(np.zeros(2), WIDTHS) == 0


def test_the_ratio_of_exposures_is_taken_off_light() -> None:
    curve = ToneCurve(np.linspace(-0.5, 0.0, 11))
    srgb = np.full((4, 2, 3), 0.25)

    light = neighbours_of(srgb, 0.5).light(curve)

    np.testing.assert_allclose(light[:2], curve.light(srgb[:2]))
    np.testing.assert_allclose(light[2:], 2 * curve.light(srgb[2:]))


def test_fewer_pairs_are_from_everywhere() -> None:
    some = neighbours_of(np.arange(4 * 9 * 3.0).reshape(4, 9, 3), 0.5).some(3)

    np.testing.assert_array_equal(some.srgb[0, :, 0], (0.0, 12.0, 24.0))
    np.testing.assert_array_equal(some.numbers, [[0, 4, 8], [9, 13, 17]])
    assert some.ratio == 0.5


def test_the_flash_photograph_is_brightened_block_by_block() -> None:
    """After the curve, and the same in what a sensor sees, whose noise grows with it."""
    curve = ToneCurve(np.linspace(-0.5, 0.0, 11))
    pairs = neighbours_of(np.full((4, 2, 3), 0.25), 0.5)
    logs = np.log([[1.0, 1.5], [2.0, 3.0]])

    brightened = pairs.brightened_by(logs)
    seen, plain = brightened.through(curve), pairs.through(curve)

    np.testing.assert_allclose(brightened.light(curve)[:2], pairs.light(curve)[:2])
    for place, factors in ((2, [1.0, 1.5]), (3, [2.0, 3.0])):
        expected = pairs.light(curve)[place] * np.array(factors)[:, None]
        np.testing.assert_allclose(brightened.light(curve)[place], expected)
    same = plain.brightened(brightened.brightened)
    np.testing.assert_allclose(same.light, seen.light)
    np.testing.assert_allclose(same.variances, seen.variances)


def test_a_flash_that_hardly_reaches_tells_nothing() -> None:
    pair = photographs(s_curve(0.0), light_of(flash=0.002))

    assert find_neighbours(blocks(pair), 1.0) is None


def test_lamps_that_light_all_places_alike_tell_nothing() -> None:
    pair = photographs(s_curve(0.0), light_of("none", flash=0.02))

    assert find_neighbours(blocks(pair), 1.0) is None


@pytest.mark.parametrize("unusable", [~nothing(), np.arange(SIZE[1])[:, None] > np.zeros(SIZE[0])])
def test_what_cannot_be_used_tells_nothing(unusable: Mask) -> None:
    pair = photographs(s_curve(0.0), light_of())

    assert find_neighbours(blocks(pair, unusable), 1.0) is None


def test_a_picture_smaller_than_the_way_to_a_neighbour_tells_nothing() -> None:
    no_flash, flash = (np.full((6, 7, 3), light, np.float32) for light in (0.2, 0.4))

    assert find_neighbours(average_pair(no_flash, flash, np.zeros((6, 7), np.bool_)), 1.0) is None
