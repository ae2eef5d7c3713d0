from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.pair.flicker import bands
from pipeline.pair.ratios import (
    Ratios,
    block_ratios,
)
from tests.unit.pipeline.pair.ratios_of_scenes import HEIGHT, QUIET, WIDTH, ratios_of, scene


def flicker(cycles: float, height: float, phase: float) -> Floats64:
    y = np.arange(HEIGHT)[:, None, None] / HEIGHT
    return np.asarray(1 + height * np.sin(2 * np.pi * (cycles * y + phase)))


@pytest.mark.parametrize("cycles", [6.0, 9.5, 20.0])
def test_bands_of_a_flickering_lamp_are_found(cycles: float) -> None:
    lamps, flash = scene()

    found = bands(
        ratios_of(lamps * flicker(cycles, 0.1, 0.1), lamps * flicker(cycles, 0.1, 0.4) + flash)
    )

    assert found is not None
    assert 0.04 < found < 0.25


def two_waves(cycles: int, beside: int, height: float) -> Ratios:
    """A wave of .05 and another of that height, of so many cycles down the rows."""
    y = np.arange(300)[:, None, None] / 300
    waves = 0.05 * np.sin(2 * np.pi * cycles * y) + height * np.sin(2 * np.pi * beside * y + 1)
    logs = np.broadcast_to(waves, (300, 100, 3))
    return Ratios(np.ones_like(logs), logs, np.full_like(logs, 1e-3), np.ones((300, 100), bool), 1)


@pytest.mark.parametrize(("cycles", "beside"), [(5, 8), (5, 9), (6, 9), (12, 15), (58, 54)])
@pytest.mark.parametrize(("height", "found"), [(0.02, False), (0.005, True)])
def test_bands_stand_out_from_every_other_wave(
    cycles: int, beside: int, height: float, found: bool
) -> None:
    """Two waves of nearly one height are no flicker, wherever they are from 5 to 60 cycles."""
    assert (bands(two_waves(cycles, beside, height)) is not None) is found


def test_the_fall_off_of_light_takes_nothing_from_bands() -> None:
    """It may leave four cycles."""
    assert bands(two_waves(20, 4, 0.02)) == pytest.approx(0.05, rel=0.1)


def test_light_that_falls_off_steeply_adds_nothing_to_bands() -> None:
    """By e³ from edge to edge, ever faster; bands of six cycles are the nearest to that."""
    flat = two_waves(6, 4, 0.0)
    fall_off = 3 * (np.arange(300)[:, None, None] / 300) ** 3

    found = bands(replace(flat, logs=flat.logs + fall_off))

    assert found == pytest.approx(bands(flat), rel=0.01)


@pytest.mark.parametrize(("blue", "found"), [(0.9, True), (0.15, False)])
def test_bands_are_in_all_channels_at_once(blue: float, found: bool) -> None:
    waves = two_waves(20, 4, 0.0)
    logs = waves.logs * np.array([1.0, 1.0, blue])

    assert (bands(replace(waves, logs=logs)) is not None) is found


def test_steady_lamps_leave_no_bands() -> None:
    lamps, flash = scene()

    assert bands(ratios_of(lamps, lamps + flash)) is None


def test_even_light_without_noise_leaves_no_bands() -> None:
    before = np.full((HEIGHT, WIDTH, 3), 0.2, np.float32)
    open_ = np.zeros(before.shape[:2], bool)
    assert bands(block_ratios(before, 2 * before, open_, (QUIET, QUIET))) is None


def test_stripes_of_a_surface_are_no_bands() -> None:
    """Red and green in turn: the channels' ratios go opposite ways."""
    lamps, flash = scene()
    y = np.arange(HEIGHT)[:, None, None] / HEIGHT
    stripe = 0.3 * np.sin(2 * np.pi * 10 * y) * np.array([1.0, -1.0, 0.2])

    assert bands(ratios_of(lamps, lamps + flash * (1 + stripe))) is None


@pytest.mark.parametrize("flash_times", [0.5, 1.0, 4.0])
def test_steady_light_through_a_blind_leaves_no_bands(flash_times: float) -> None:
    lamps, flash = scene()
    y = np.arange(HEIGHT)[:, None, None] / HEIGHT
    striped = lamps * (0.6 + 0.8 * (np.sin(2 * np.pi * 11 * y) > 0.2))

    found = ratios_of(striped, striped + flash_times * flash)

    assert np.ptp(np.median(found.logs.mean(axis=2), axis=1)) > 0.15  # though the ratio has them
    assert bands(found) is None


def test_bands_along_columns_are_no_flicker() -> None:
    lamps, flash = scene()
    x = np.arange(WIDTH)[None, :, None] / WIDTH

    found = ratios_of(lamps, (lamps + flash) * (1 + 0.1 * np.sin(2 * np.pi * 9 * x)))

    assert bands(found) is None


def test_black_pictures_leave_no_bands() -> None:
    dark = np.zeros((64, 64, 3), np.float32)
    assert bands(block_ratios(dark, dark, np.zeros((64, 64), bool), (QUIET, QUIET))) is None
