from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.pair.reduced import ReducedPair, reduce_pair
from pipeline.pictures.lettering import panel
from pipeline.pictures.residual_map import LEGEND, MOST, draw_residual_map, relative_residual

Exact = Callable[..., tuple[Any, Floats64]]

PATCH = (slice(20, 28), slice(40, 52))


@pytest.fixture
def two(exact: Exact, warm_to_cool: Floats64) -> ReducedPair:
    """A reduced pair that two lamps explain."""
    return reduce_pair(exact(warm_to_cool[[0, 2]])[0])


@pytest.mark.parametrize("which", [[0], [0, 2], [0, 1, 2]])
def test_what_the_model_describes_leaves_nothing(
    exact: Exact, lamps_of: Callable[..., Any], warm_to_cool: Floats64, which: list[int]
) -> None:
    reduced = reduce_pair(exact(warm_to_cool[which])[0])

    found = relative_residual(reduced, lamps_of(warm_to_cool[which]))

    assert found.shape == reduced.usable.shape
    assert found.dtype == np.float32
    assert np.nanmax(found) < 0.01


def test_light_of_another_colour_leaves_its_part_of_the_light(
    two: ReducedPair, lamps_of: Callable[..., Any], warm_to_cool: Floats64
) -> None:
    """By hand: what is added at right angles to both lamps' light is left, and nothing else."""
    lamps = lamps_of(warm_to_cool[[0, 2]])
    lit = np.einsum("nkl,hwl->nhwk", lamps.matrices, two.flash[PATCH].astype(np.float64))
    across = np.cross(lit[0], lit[1])
    across /= np.linalg.norm(across, axis=2, keepdims=True)
    before = two.no_flash[PATCH].astype(np.float64)
    brightness = np.linalg.norm(before, axis=2, keepdims=True)
    no_flash = two.no_flash.copy()
    no_flash[PATCH] = before + 0.5 * brightness * across

    found = relative_residual(replace(two, no_flash=no_flash), lamps)

    np.testing.assert_allclose(found[PATCH], 0.5 / np.sqrt(1.25), rtol=0.02)
    elsewhere = np.ones(found.shape, bool)
    elsewhere[PATCH] = False
    assert np.nanmax(found[elsewhere]) < 0.01


def test_a_missing_lamp_shows_where_it_shines(
    two: ReducedPair, lamps_of: Callable[..., Any], warm_to_cool: Floats64
) -> None:
    """Only the warm lamp is known; the cool one shines on the right."""
    found = relative_residual(two, lamps_of(warm_to_cool[:1]))

    assert np.nanmedian(found[:, :20]) < 0.01
    assert np.nanmedian(found[:, 80:]) > 0.2


def test_what_is_not_usable_is_not_a_number(
    two: ReducedPair, lamps_of: Callable[..., Any], warm_to_cool: Floats64
) -> None:
    usable = two.usable.copy()
    usable[PATCH] = False

    found = relative_residual(replace(two, usable=usable), lamps_of(warm_to_cool[[0, 2]]))

    np.testing.assert_array_equal(np.isnan(found), ~usable)


def test_noise_is_taken_off(
    two: ReducedPair, lamps_of: Callable[..., Any], warm_to_cool: Floats64
) -> None:
    """Noise of 3 % that is known leaves hardly a pixel anything."""
    rng = np.random.default_rng(2)
    sigma = (0.03 * two.no_flash).astype(np.float32)
    noisy = (two.no_flash + sigma * rng.normal(size=sigma.shape)).astype(np.float32)
    lamps = lamps_of(warm_to_cool[[0, 2]])

    told = relative_residual(replace(two, no_flash=noisy, no_flash_variance=sigma**2), lamps)
    untold = relative_residual(replace(two, no_flash=noisy), lamps)

    assert np.nanmedian(untold) > 0.005
    assert np.mean(told > 0) < 0.02


def test_noise_of_the_flash_counts_through_the_lamps(
    two: ReducedPair, lamps_of: Callable[..., Any], warm_to_cool: Floats64
) -> None:
    rng = np.random.default_rng(2)
    sigma = (0.03 * two.flash).astype(np.float32)
    noisy = (two.flash + sigma * rng.normal(size=sigma.shape)).astype(np.float32)
    lamps = lamps_of(warm_to_cool[[0, 2]])

    told = relative_residual(replace(two, flash=noisy, flash_variance=sigma**2), lamps)
    untold = relative_residual(replace(two, flash=noisy), lamps)

    assert np.nanmedian(untold) > 0.005
    assert np.nanmedian(told) < 0.5 * np.nanmedian(untold)


def test_channels_are_weighed_as_when_the_layers_are_made(
    two: ReducedPair, lamps_of: Callable[..., Any], warm_to_cool: Floats64
) -> None:
    """As of a camera whose channels are so much brighter, of light that no lamp explains."""
    weights = np.array([0.5, 1.0, 3.0], np.float32)
    rng = np.random.default_rng(3)
    odd = (two.no_flash * rng.uniform(0.5, 1.5, two.no_flash.shape)).astype(np.float32)
    variance = (1e-3 * odd**2).astype(np.float32)
    pair = replace(two, no_flash=odd, no_flash_variance=variance, flash_variance=variance)
    pair = replace(pair, flash_only=True)  # so that one may be brighter without the other
    lamps = lamps_of(warm_to_cool[[0, 2]])

    found = relative_residual(pair, replace(lamps, channel_weights=weights))

    brighter = replace(pair, no_flash=odd * weights, no_flash_variance=variance * weights**2)
    scaled = replace(lamps, matrices=weights[:, None] * lamps.matrices)
    np.testing.assert_allclose(found, relative_residual(brighter, scaled), rtol=1e-3, atol=1e-4)
    assert np.nanmedian(np.abs(found - relative_residual(pair, lamps))) > 0.01


def test_black_pixels_leave_nothing_where_usable(
    two: ReducedPair, lamps_of: Callable[..., Any], warm_to_cool: Floats64
) -> None:
    black = replace(two, no_flash=np.zeros_like(two.no_flash), flash=np.zeros_like(two.flash))

    found = relative_residual(black, lamps_of(warm_to_cool[[0, 2]]))

    np.testing.assert_array_equal(found, np.where(two.usable, 0, np.nan))


# the picture


def brightness(picture: NDArray[np.uint8]) -> Floats64:
    return picture.astype(np.float64) @ [0.3, 0.6, 0.1]


def test_the_map_has_a_legend_and_is_wide_enough_for_it() -> None:
    picture = draw_residual_map(np.zeros((64, 96), np.float32))

    assert picture.shape == (640 + LEGEND, 960, 3)
    assert picture.dtype == np.uint8
    assert draw_residual_map(np.zeros((300, 512), np.float32)).shape == (600 + LEGEND, 1024, 3)


@pytest.mark.parametrize(("height", "factor"), [(507, 4), (2000, 1), (3000, 1)])
def test_a_tall_narrow_map_has_a_margin_for_the_legend(height: int, factor: int) -> None:
    residual = np.full((height, 9), MOST, np.float32)

    picture = draw_residual_map(residual)

    assert picture.shape == (factor * height + LEGEND, 900, 3)
    assert brightness(picture[: factor * height, : 9 * factor]).min() > 150
    np.testing.assert_array_equal(
        picture[: factor * height, 9 * factor :], panel(factor * height, 900 - 9 * factor)
    )


def test_more_is_brighter_up_to_the_end_of_the_scale() -> None:
    values = np.array([0, 0.05, 0.1, 0.15, MOST, 3 * MOST], np.float32)

    shown = brightness(draw_residual_map(values[None].repeat(6, axis=0))[0, 75::150])

    assert (np.diff(shown)[:4] > 20).all()
    assert shown[5] == shown[4]


def test_what_is_not_usable_is_grey() -> None:
    values = np.full((30, 30), 0.02, np.float32)
    values[10:20, 10:20] = np.nan

    picture = draw_residual_map(values)[:900]

    grey = (picture == (90, 90, 95)).all(axis=2)
    assert grey[300:600, 300:600].all()
    assert grey.sum() == 300 * 300


def test_the_legend_shows_the_scale() -> None:
    legend = draw_residual_map(np.zeros((64, 96), np.float32))[-LEGEND:]

    bar = brightness(legend[52, 24:384])
    assert (np.diff(bar) >= -1.5).all()
    assert bar[-1] > bar[0] + 150
    assert (legend == (90, 90, 95)).all(axis=2).sum() > 300
    assert (legend.min(axis=2) > 150).any(axis=1).sum() > 30  # words


def test_the_legend_says_in_two_lines_what_is_not_usable() -> None:
    legend = draw_residual_map(np.full((9, 9), np.nan, np.float32))[-LEGEND:]

    words = legend[:, 554:].min(axis=2) > 150
    assert words[44:62].any()
    assert words[68:86].any()
    assert not words[:, 900 - 8 - 554 :].any()


@pytest.mark.parametrize("shape", [(1, 1), (3, 700), (700, 3)])
def test_odd_shapes_are_drawn(shape: tuple[int, int]) -> None:
    picture = draw_residual_map(np.full(shape, np.nan, np.float32))

    factor = min(-(-900 // shape[1]), 2048 // shape[0])
    assert picture.shape == (shape[0] * factor + LEGEND, max(shape[1] * factor, 900), 3)
