from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.images.noise import Noise
from pipeline.pair.flat_noise import estimate_noises
from pipeline.pair.steadiness import (
    Ratios,
    bands,
    block_ratios,
    brightening,
    darker_share,
    ratio_without_flash,
)

HEIGHT, WIDTH = 192, 256
LAMP, FLASH = np.array([1.0, 0.7, 0.4]), np.array([0.7, 0.9, 1.0])
QUIET = Noise(np.full(3, 1e-8), np.full(3, 1e-11))


def albedo(seed: int = 1) -> Floats64:
    values = np.random.default_rng(seed).uniform(0.2, 0.9, (HEIGHT // 16, WIDTH // 16, 3))
    return values.repeat(16, 0).repeat(16, 1)


def ratios_of(
    lamps: Floats64, flash_frame: Floats64, unusable: NDArray[np.bool_] | None = None
) -> Ratios:
    """Of the photographs with the noise of a sensor."""
    rng = np.random.default_rng(5)
    one, other = (
        (light + rng.normal(size=light.shape) * np.sqrt(light / 2e4 + 1e-7)).astype(np.float32)
        for light in (lamps, flash_frame)
    )
    bad = np.zeros(lamps.shape[:2], bool) if unusable is None else unusable
    return block_ratios(one, other, bad, estimate_noises(one, other))


def scene(reach: float = 1.0) -> tuple[Floats64, Floats64]:
    """Light of lamps and of a flash that reaches so much of the picture from the right."""
    u = np.linspace(0, 1, WIDTH)[None, :, None]
    lamps = albedo() * (0.2 + 0.4 * (1 - u)) * LAMP
    flash = albedo() * 0.4 * FLASH * (0.5 + 0.5 * u) * (u > 1 - reach)
    return lamps, flash


def test_ratios_are_those_of_the_blocks() -> None:
    before = np.full((64, 800, 3), 0.2, np.float32)
    after = before * np.array([1.5, 2.0, 3.0], np.float32)
    clipped = np.zeros((64, 800), bool)
    clipped[:, 400:] = True

    found = block_ratios(before, after, clipped, (QUIET, QUIET))

    assert found.logs.shape == (64 // 3, 800 // 3, 3)
    np.testing.assert_allclose(
        np.exp(found.logs[:, :133]), np.tile([1.5, 2, 3], (21, 133, 1)), rtol=1e-5
    )
    assert found.usable[:, :133].all()
    assert not found.usable[:, 133:].any()


def test_blocks_that_hold_something_else_are_left_out_as_if_they_had_been_unusable() -> None:
    lamps, flash = scene()
    moved = np.zeros(lamps.shape[:2], bool)
    moved[20:60, 33:101] = True

    found = ratios_of(lamps, lamps + flash).without(moved)

    expected = ratios_of(lamps, lamps + flash, moved)
    np.testing.assert_array_equal(found.usable, expected.usable)
    np.testing.assert_array_equal(found.logs, expected.logs)


def test_noise_of_a_ratio_is_that_of_both_parts() -> None:
    noise = Noise(np.zeros(3), np.full(3, 1e-4))
    before, after = np.full((40, 40, 3), 0.2, np.float32), np.full((40, 40, 3), 0.5, np.float32)

    found = block_ratios(before, after, np.zeros((40, 40), bool), (noise, noise))

    np.testing.assert_allclose(found.noise, np.sqrt(1e-4 / 0.04 + 1e-4 / 0.25), rtol=1e-4)


@pytest.mark.parametrize("ratio", [0.25, 0.7, 1.0, 2.0])
@pytest.mark.parametrize("reach", [0.5, 0.9])
def test_what_the_flash_does_not_reach_shows_the_ratio(ratio: float, reach: float) -> None:
    lamps, flash = scene(reach)

    found = ratio_without_flash(ratios_of(lamps, ratio * (lamps + flash)))

    assert found == pytest.approx(ratio, rel=0.02)


def test_a_flash_that_reaches_everything_shows_no_ratio() -> None:
    lamps, flash = scene()

    assert ratio_without_flash(ratios_of(lamps, lamps + flash)) is None


def test_a_wall_that_the_flash_lights_evenly_shows_no_ratio() -> None:
    """A peak at one ratio, but the channels have ratios of their own."""
    even = albedo() * 0.3 * LAMP
    u = np.linspace(0, 1, WIDTH)[None, :, None]

    found = ratios_of(even, even + albedo() * FLASH * np.where(u < 0.5, 0.2, 0.2 + 0.4 * u))

    assert ratio_without_flash(found) is None


def test_a_lamp_nearly_of_the_colour_of_the_flash_shows_no_ratio_in_noise() -> None:
    """Blocks agree within their noise, their means do not: a lamp in patches, brighter than all."""
    rng = np.random.default_rng(5)
    logs = np.tile([0.14, 0.155, 0.17], (60, 60, 1))
    logs[:, 6:] = [0.4, 0.6, 0.8] + 0.3 * rng.random((60, 54, 1))
    logs += 0.025 * rng.normal(size=logs.shape)
    noise = np.full_like(logs, 0.025)
    found = Ratios(np.ones_like(logs), logs, noise, np.ones((60, 60), bool), 1)

    assert ratio_without_flash(found) is None


def test_a_lamp_of_the_colour_of_the_flash_shows_no_ratio() -> None:
    """Channels agree everywhere, so that agreement tells nothing."""
    u = np.linspace(0, 1, WIDTH)[None, :, None]
    lamps, flash = albedo() * 0.3, albedo() * np.where(u < 0.4, 0.1, 0.3 + 0.3 * u)

    assert ratio_without_flash(ratios_of(lamps, lamps + flash)) is None


def test_black_pictures_show_nothing() -> None:
    dark = np.zeros((64, 64, 3), np.float32)
    found = block_ratios(dark, dark, np.zeros((64, 64), bool), (QUIET, QUIET))

    assert not found.sure.any()
    assert ratio_without_flash(found) is None
    assert darker_share(found, rendered=False) == 0
    assert bands(found) is None


@pytest.mark.parametrize(
    ("left", "rendered", "share"),
    [(1.0, False, 0.0), (0.9, False, 0.4), (0.9, True, 0.0), (0.7, True, 0.4)],
)
def test_share_that_is_darker_with_the_flash(left: float, rendered: bool, share: float) -> None:
    lamps, flash = scene(reach=0.6)

    found = ratios_of(lamps, np.where(flash > 0, lamps + flash, left * lamps))

    assert darker_share(found, rendered) == pytest.approx(share, abs=0.02)


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


@pytest.mark.parametrize(("left", "times"), [(0.5, 2.0), (0.8, 1.25)])
def test_how_much_brighter_a_darkened_photograph_must_be(left: float, times: float) -> None:
    lamps, _ = scene()

    assert brightening(ratios_of(lamps, left * lamps)) == pytest.approx(times, rel=0.03)


def test_what_is_nowhere_darker_need_not_be_brighter() -> None:
    lamps, flash = scene()

    assert brightening(ratios_of(lamps, lamps + flash)) == 1


def test_of_black_pictures_no_brightness_is_known() -> None:
    black = np.zeros((40, 60, 3))

    assert brightening(ratios_of(black, black)) == 1
