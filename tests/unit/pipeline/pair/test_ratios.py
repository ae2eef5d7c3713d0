from __future__ import annotations

import numpy as np
import pytest

from pipeline.images.noise import Noise
from pipeline.pair.ratios import (
    Ratios,
    block_ratios,
    brightening,
    darker_share,
    ratio_without_flash,
)
from tests.unit.pipeline.pair.ratios_of_scenes import (
    FLASH,
    LAMP,
    QUIET,
    WIDTH,
    albedo,
    ratios_of,
    scene,
)


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


@pytest.mark.parametrize(
    ("left", "rendered", "share"),
    [(1.0, False, 0.0), (0.9, False, 0.4), (0.9, True, 0.0), (0.7, True, 0.4)],
)
def test_share_that_is_darker_with_the_flash(left: float, rendered: bool, share: float) -> None:
    lamps, flash = scene(reach=0.6)

    found = ratios_of(lamps, np.where(flash > 0, lamps + flash, left * lamps))

    assert darker_share(found, rendered) == pytest.approx(share, abs=0.02)


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
