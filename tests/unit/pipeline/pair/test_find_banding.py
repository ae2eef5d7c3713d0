"""Ratios of paint in the shadows of two lamps that flicker, under a flash."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.pair.banding import Banding, series
from pipeline.pair.find_banding import _Search, find_banding
from pipeline.pair.ratios import Ratios
from tests.unit.pipeline.pair.ratios_of_scenes import ratios_of
from tests.unit.pipeline.pair.shadows_on_paint import SIZE, light_of

WIDTH, HEIGHT = SIZE


def waves(cycles: float, height: float, phase: float, side: int = HEIGHT) -> Floats64:
    y = (np.arange(side) + 0.5) / side
    return np.asarray(1 + height * np.sin(2 * np.pi * (cycles * y + phase)))[:, None, None]


def flickering(cycles: float, height: float, flash: float = 0.35) -> Ratios:
    """Lamps of which every row has waves of that height, of another phase with the flash."""
    lamps, both = light_of(flash=flash)
    before, after = (lamps * waves(cycles, height, phase) for phase in (0.1, 0.45))
    return ratios_of(before, after + both - lamps)


def changes(found: Banding, side: int) -> Floats64:
    return np.asarray(found.terms @ series((np.arange(side) + 0.5) / found.period))


@pytest.mark.parametrize("cycles", [0.8, 2.3, 9.5])
@pytest.mark.parametrize("height", [0.15, 0.2])
def test_what_rows_gave_more_is_found(cycles: float, height: float) -> None:
    found = find_banding(flickering(cycles, height), by_columns=False)

    assert found is not None
    expected = (waves(cycles, height, 0.45) / waves(cycles, height, 0.1))[:, 0, 0] - 1
    error = changes(found, HEIGHT) - expected
    assert np.sqrt(np.square(error).mean()) < 0.25 * np.sqrt(np.square(expected).mean())


def test_of_an_upright_picture_rows_are_columns() -> None:
    ratios = flickering(6.0, 0.2)
    one, turned = find_banding(ratios, False), find_banding(ratios.transposed(), True)

    assert one is not None
    assert turned is not None
    assert turned.by_columns
    assert turned.period == pytest.approx(one.period, rel=0.02)
    np.testing.assert_allclose(changes(turned, HEIGHT), changes(one, HEIGHT), atol=0.03)


def test_larger_blocks_say_the_same_of_more_rows() -> None:
    ratios = flickering(6.0, 0.2)
    one, larger = (find_banding(replace(ratios, block=block), False) for block in (1, 7))

    assert one is not None
    assert larger is not None
    assert larger.period == pytest.approx(7 * one.period)
    np.testing.assert_array_equal(larger.terms, one.terms)


def test_rows_that_blocks_leave_over_move_no_wave() -> None:
    """Blocks of four, of 214 rows: 36 cycles to a thousand."""
    lamps, both = light_of()
    y = (np.arange(HEIGHT) + 0.5)[:, None, None]
    before, after = (lamps * (1 + 0.2 * np.sin(2 * np.pi * (y / 36 + p))) for p in (0.1, 0.45))
    cut = slice(214)

    found = find_banding(ratios_of(before[cut], (after + both - lamps)[cut]), False)

    assert found is not None
    assert found.period == pytest.approx(36, rel=0.01)


@pytest.mark.parametrize("flash", [0.2, 0.35, 1.5])
@pytest.mark.parametrize("factor", [0.85, 1.0, 1.5])
def test_steady_lamps_have_no_bands(factor: float, flash: float) -> None:
    """Whatever ratio of the exposures was given."""
    steady = ratios_of(*light_of(flash=flash))

    found = find_banding(replace(steady, logs=steady.logs + np.log(factor)), by_columns=False)

    assert found is None


def test_bands_across_the_rows_are_none() -> None:
    lamps, both = light_of()
    before, after = (
        lamps * waves(6.0, 0.2, phase, WIDTH).transpose(1, 0, 2) for phase in (0.1, 0.45)
    )

    assert find_banding(ratios_of(before, after + both - lamps), by_columns=False) is None


def test_even_light_tells_nothing() -> None:
    lamps, both = light_of("none")
    before, after = (lamps * waves(6.0, 0.2, phase) for phase in (0.1, 0.45))

    assert find_banding(ratios_of(before, after + both - lamps), by_columns=False) is None


def test_where_the_flash_adds_nothing_nothing_is_told() -> None:
    lamps, _ = light_of()

    assert find_banding(ratios_of(lamps, 0.9 * lamps), by_columns=False) is None


def test_where_nothing_can_be_used_nothing_is_told() -> None:
    ratios = flickering(6.0, 0.2)
    unusable = replace(ratios, usable=np.zeros_like(ratios.usable))

    assert find_banding(unusable, by_columns=False) is None


@pytest.mark.parametrize(("alike", "told"), [(20, False), (40, True)])
def test_a_peak_of_few_pairs_is_noise(alike: int, told: bool) -> None:
    """.86 % for each ten of a thousand that are of one paint; 2.25 % are asked for."""
    random = np.random.default_rng(4)
    paint = random.uniform(0.5, 0.9, (1000, 3))
    other = paint.copy()
    other[alike:, 0] *= 3
    rows = random.uniform(0, 1, (2, 1000))
    lamp = np.stack([0.6 * paint, 0.6 * other]) * [1.0, 0.6, 0.3]
    more = 0.2 * np.sin(4 * np.pi * rows)[..., None] * lamp

    found = _Search(np.stack([paint, other]) + more, lamp, rows).found()

    assert (found is not None) == told
    if found is not None:
        assert found[0] == pytest.approx(2.0, abs=0.05)
