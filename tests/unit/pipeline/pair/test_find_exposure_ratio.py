"""Ratios of paint in the shadows of two lamps, under a flash that reaches everything."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.pair.find_exposure_ratio import find_exposure_ratio
from pipeline.pair.ratios import Ratios
from tests.unit.pipeline.pair.ratios_of_scenes import (
    FLASH,
    LAMP,
    albedo,
    ratios_of,
    scene,
)
from tests.unit.pipeline.pair.shadows_on_paint import light_of


def brought_by(factor: float, ratios: Ratios) -> Ratios:
    """The same pair on the scale of a ratio that is so many times the right one."""
    return replace(ratios, logs=ratios.logs - np.log(factor))


def with_flash(lamps: Floats64, flash: Floats64) -> Ratios:
    return ratios_of(lamps, lamps + flash)


def in_shadows(flash: float = 0.35) -> Ratios:
    return ratios_of(*light_of(flash=flash))


@pytest.mark.parametrize("factor", [0.125, 0.5, 0.8, 1.25, 2.0, 8.0])
@pytest.mark.parametrize("flash", [0.2, 0.35])
def test_a_wrong_ratio_is_told_to_a_percent(factor: float, flash: float) -> None:
    found = find_exposure_ratio(brought_by(factor, in_shadows(flash)))

    assert found == pytest.approx(1 / factor, rel=0.01)


@pytest.mark.parametrize("factor", [0.95, 1.0, 1.05])
def test_a_right_ratio_stays(factor: float) -> None:
    assert find_exposure_ratio(brought_by(factor, in_shadows())) == 1.0


@pytest.mark.parametrize(("factor", "told"), [(0.25, 4.0), (0.8, None), (1.25, None), (4.0, 0.25)])
def test_of_a_strong_flash_only_a_very_wrong_ratio_is_told(
    factor: float, told: float | None
) -> None:
    """The lamps' light changes its colour little."""
    found = find_exposure_ratio(brought_by(factor, in_shadows(flash=1.5)))

    assert found == (told if told is None else pytest.approx(told, rel=0.03))


def test_neither_things_that_are_black_nor_clipped_count() -> None:
    lamps, both = light_of()
    left = np.s_[:, :120]
    bad = np.zeros(lamps.shape[:2], bool)
    lamps[left], both[left], bad[left] = 1.0, 1.0, True
    lamps[:40], both[:40] = 1e-9, 2e-9

    found = find_exposure_ratio(brought_by(2.0, ratios_of(lamps, both, bad)))

    assert found == pytest.approx(0.5, rel=0.03)


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_a_weak_flash_tells_nothing(factor: float) -> None:
    assert find_exposure_ratio(brought_by(factor, in_shadows(flash=0.1))) is None


def test_noise_of_blocks_is_averaged() -> None:
    ratios = in_shadows()
    noise = np.random.default_rng(2).normal(0, 0.1, ratios.logs.shape)

    found = find_exposure_ratio(brought_by(2.0, replace(ratios, logs=ratios.logs + noise)))

    assert found == pytest.approx(0.5, rel=0.03)


def test_a_ratio_that_is_hardly_wrong_is_neither_right_nor_told() -> None:
    assert find_exposure_ratio(brought_by(0.93, in_shadows())) is None


def test_blocks_that_cannot_be_used_count_for_nothing() -> None:
    """A third of them, spread evenly, in which the flash photograph is dark."""
    ratios = in_shadows()
    dark = np.indices(ratios.usable.shape).sum(axis=0) % 3 == 0
    logs = np.where(dark[..., None], -3.0, ratios.logs)
    marked = replace(ratios, logs=logs, usable=ratios.usable & ~dark)

    assert find_exposure_ratio(brought_by(2.0, marked)) == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize(("usable", "told"), [(13, True), (12, False)])
def test_larger_blocks_of_which_half_can_be_used_tell(usable: int, told: bool) -> None:
    """Of 5 × 5 smaller ones."""
    ratios = in_shadows()
    rows, columns = np.indices(ratios.usable.shape) % 5
    some = replace(ratios, usable=np.asarray(5 * rows + columns < usable))

    found = find_exposure_ratio(brought_by(2.0, some))

    assert found == (pytest.approx(0.5, rel=0.02) if told else None)


def test_lamps_of_the_colour_of_the_flash_tell_nothing() -> None:
    lamps, flash = scene()

    for factor in (0.5, 1.0, 2.0):
        assert (
            find_exposure_ratio(brought_by(factor, with_flash(lamps / LAMP * FLASH, flash))) is None
        )


def test_an_even_share_of_the_lamps_tells_nothing() -> None:
    lamps, _ = scene()

    for factor in (0.5, 1.0, 2.0):
        assert (
            find_exposure_ratio(brought_by(factor, with_flash(lamps, lamps / LAMP * FLASH))) is None
        )


@pytest.mark.parametrize(("unevenness", "told"), [(0.01, 0.05), (0.03, None)])
def test_what_is_hardly_better_than_no_light_of_lamps_is_not_told(
    unevenness: float, told: float | None
) -> None:
    """Where a photograph has one colour itself, every low ratio leaves nearly as much of it."""
    lamps, flash = scene()
    uneven = np.random.default_rng(1).standard_normal((48, 64, 3)).repeat(4, 0).repeat(4, 1)
    both = (0.6 * flash / albedo() + 0.05 * lamps) * np.exp(unevenness * uneven)

    found = find_exposure_ratio(ratios_of(lamps, both))

    assert found == (told if told is None else pytest.approx(told, rel=0.02))


def test_unusable_pairs_and_few_blocks_tell_nothing() -> None:
    ratios = in_shadows()
    few = np.s_[60:72, 100:112]
    cut = Ratios(ratios.no_flash[few], ratios.logs[few], ratios.noise[few], ratios.usable[few], 1)

    assert find_exposure_ratio(replace(ratios, usable=np.zeros_like(ratios.usable))) is None
    assert find_exposure_ratio(brought_by(2.0, cut)) is None
