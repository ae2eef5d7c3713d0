from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.images.coded_image import TableImage
from pipeline.images.frames import Mask
from pipeline.pair.ratios import Ratios
from pipeline.pair.relative_blur import (
    _NOTHING,
    RelativeBlur,
    _Moments,
    _surely,
    blur_kernel,
    blurred,
    blurred_mask,
    find_relative_blur,
)
from tests.unit.pipeline.pair.ratios_of_scenes import FLASH, HEIGHT, LAMP, WIDTH, ratios_of

SHAKEN = np.array([[1.0, 0.3], [0.3, 0.4]])
SHARP = np.zeros((2, 2))


def photographs(
    no_flash: Floats64 = SHARP, flash: Floats64 = SHARP, times: int = 1, seed: int = 2
) -> tuple[Floats64, Floats64]:
    """Painted spots in the light of a lamp with a shadow, and with a flash; each blurred so much.

    times: how much larger all is, the blur with it. seed: of the spots.
    """
    random = np.random.default_rng(seed)
    size = HEIGHT * times, WIDTH * times
    paint = random.uniform(0.2, 0.9, (HEIGHT // 8, WIDTH // 8, 3))
    paint = np.asarray(cv2.resize(paint, size[::-1], interpolation=cv2.INTER_NEAREST), np.float64)
    u = np.linspace(0, 1, size[1])[None, :, None]
    shadow = np.where((u > 0.4) & (u < 0.6), 0.3, 1.0)
    lamps = paint * (0.5 - 0.2 * u) * LAMP * shadow
    both = lamps + paint * 0.4 * FLASH * (0.5 + 0.5 * u)
    return tuple(  # type: ignore[return-value]
        blurred(light.astype(np.float32), blur_kernel(times**2 * covariance)).astype(np.float64)
        for light, covariance in ((lamps, no_flash), (both, flash))
    )


def told(no_flash: Floats64, flash: Floats64, unusable: Mask | None = None) -> RelativeBlur | None:
    """The blur found in photographs with the noise of a sensor."""
    bad = np.zeros(no_flash.shape[:2], bool) if unusable is None else unusable
    return find_relative_blur(ratios_of(no_flash, flash, bad), bad)


def test_a_shaken_photograph_is_told_with_its_covariance() -> None:
    found = told(*photographs(no_flash=SHAKEN))

    assert found is not None
    np.testing.assert_allclose(found.no_flash, SHAKEN, atol=0.12)
    assert found.no_flash_px == pytest.approx(np.sqrt(np.linalg.eigvalsh(SHAKEN)[1]), rel=0.06)
    assert found.flash_px == 0


def test_photographs_as_sharp_as_each_other_are_not_told() -> None:
    assert told(*photographs()) is None
    assert told(*photographs(SHAKEN, SHAKEN)) is None


@pytest.mark.parametrize(("share", "veiled"), [(0.3, 0), (0.65, 1)])
def test_shading_around_edges_is_no_blur(share: float, veiled: int) -> None:
    """Some of the light is wide, as where a lamp shades shiny things otherwise than the flash."""
    light, wide = [*photographs()], photographs(9 * np.eye(2), 9 * np.eye(2))
    light[veiled] = (1 - share) * light[veiled] + share * wide[veiled]

    assert told(light[0], light[1]) is None


def test_a_flash_photograph_that_is_less_sharp_is_told_with_its_covariance() -> None:
    found = told(*photographs(flash=np.diag([2.0, 0.3])))

    assert found is not None
    np.testing.assert_allclose(found.flash, np.diag([2.0, 0.3]), atol=0.15)
    assert found.flash_px == pytest.approx(np.sqrt(2.0), rel=0.06)
    assert not found.no_flash.any()
    assert not found.offset.any()
    assert found.no_flash_px == 0


def test_each_photograph_may_be_blurred_along_another_direction() -> None:
    shaken = np.diag([1.6, 0.0]), np.diag([0.0, 1.6])
    found = told(*photographs(*shaken))

    assert found is not None
    np.testing.assert_allclose(found.no_flash, shaken[0], atol=0.4)
    np.testing.assert_allclose(found.flash, shaken[1], atol=0.4)


def test_a_blur_so_wide_that_steps_no_longer_agree_is_told_by_half_the_size() -> None:
    wide = 8 * SHAKEN
    shaken, soft = told(*photographs(no_flash=wide)), told(*photographs(flash=wide))

    assert shaken is not None
    np.testing.assert_allclose(shaken.no_flash, wide, rtol=0.1)
    assert not shaken.flash.any()
    assert soft is not None
    np.testing.assert_allclose(soft.flash, wide, rtol=0.15)
    assert not soft.no_flash.any()


@pytest.mark.parametrize(("variance", "is_told"), [(0.55, False), (1.1, True)])
def test_a_flash_photograph_must_be_less_sharp_by_more(variance: float, is_told: bool) -> None:
    even = np.diag([variance, variance])

    found = told(*photographs(flash=even))
    other = told(*photographs(no_flash=even))

    assert (found is not None) == is_told
    assert other is not None
    np.testing.assert_allclose(other.no_flash, even, atol=0.15)


def test_moments_in_blocks_half_as_large_are_those_of_twice_the_lengths() -> None:
    found = _Moments(SHAKEN, np.array([1.0, -2.0]), np.diag([1.0, 2.0, 3.0])).doubled()

    np.testing.assert_allclose(found.covariance, 4 * SHAKEN)
    np.testing.assert_allclose(found.mean, (2.0, -4.0))
    np.testing.assert_allclose(found.error, np.diag([16.0, 32.0, 48.0]))


def surely(
    xx: float,
    yy: float,
    xy: float = 0.0,
    error: tuple[float, float, float] = (0.0, 0.0, 0.0),
    grown: tuple[float, float] = (1.0, 1.0),
) -> bool:
    """Whether moments are sure of which a variance of .33 at least counts.

    error: standard ones of xx, xy and yy. grown: times xx and yy by coarser steps.
    """
    covariance = np.array([[xx, xy], [xy, yy]])
    found = _Moments(covariance, np.array([1.0, -0.5]), np.diag(np.square(error)))
    coarse = replace(found, covariance=covariance * np.add.outer(grown, grown) / 2)
    return _surely(found, coarse, 0.33)


@pytest.mark.parametrize(
    ("found", "sure"),
    [
        ((0.34, 0.0), True),  # a third of a block's side, squared
        ((0.32, 0.0), False),
        ((-1.25, 0.0), False),  # the other photograph's
        ((1.0, 0.0, 0.0, (0.16, 0.0, 1.0)), True),  # six standard errors along that axis
        ((1.0, 0.0, 0.0, (0.17, 0.0, 0.0)), False),
        ((1.0, 1.0, 1.0, (0.0, 0.32, 0.0)), True),
        ((1.0, 1.0, 1.0, (0.0, 0.34, 0.0)), False),
    ],
)
def test_a_blur_is_sure_beyond_a_least_and_its_errors(found: Any, sure: bool) -> None:
    assert surely(*found) == sure


@pytest.mark.parametrize(
    ("found", "grown", "sure"),
    [
        ((1.0, 0.1), (1.55, 9.0), True),  # along the axis of what is told alone
        ((1.0, 0.1), (1.65, 1.0), False),
    ],
)
def test_a_blur_is_no_wider_by_coarser_steps(
    found: tuple[float, float], grown: tuple[float, float], sure: bool
) -> None:
    assert surely(*found, grown=grown) == sure


def test_a_blur_is_told_in_pixels_of_large_photographs() -> None:
    found = told(*photographs(SHAKEN, times=3))

    assert found is not None
    np.testing.assert_allclose(found.no_flash, 9 * SHAKEN, atol=9 * 0.15)

    soft = told(*photographs(flash=2 * SHAKEN, times=3))

    assert soft is not None
    np.testing.assert_allclose(soft.flash, 18 * SHAKEN, atol=18 * 0.15)


def test_too_little_that_agrees_tells_nothing() -> None:
    """The flash photograph shows other things but for a corner."""
    lamps, both = photographs(no_flash=SHAKEN)
    _, other = photographs(seed=3)
    other[:40, :60] = both[:40, :60]

    assert told(lamps, other) is None


def test_a_blur_that_parts_of_the_picture_do_not_share_is_not_sure() -> None:
    """Of somewhat more than half of it: its mean is .47, with a standard error of .14."""
    sharp, both = photographs()
    mixed = np.where(np.arange(WIDTH)[:, None] < 152, photographs(no_flash=SHAKEN)[0], sharp)

    assert told(mixed, both) is None


@pytest.mark.parametrize(("times", "apart"), [(2, 64), (8, 128)])
def test_edges_of_clipped_places_tell_nothing(times: int, apart: int) -> None:
    """They are as sharp in both, whatever the blur is."""
    lamps, both = photographs(no_flash=times * SHAKEN)
    clipped = np.zeros((HEIGHT, WIDTH), bool)
    for x in range(0, WIDTH, apart):
        clipped[:, x : x + 6] = True
    lamps[clipped] = both[clipped] = 1.0

    found = told(lamps, both, clipped)

    assert found is not None
    np.testing.assert_allclose(found.no_flash, times * SHAKEN, atol=0.2 * times)


def test_outlines_before_black_tell_it_where_nothing_is_painted() -> None:
    """Dark blocks are left out of the ratios of the exposures, but not here."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    disks: Floats64 = ((x % 24 - 11.5) ** 2 + (y % 24 - 11.5) ** 2 < 80)[..., None].astype(float)
    lamps = blurred((disks * 0.4 * LAMP).astype(np.float32), blur_kernel(SHAKEN))

    found = told(np.maximum(lamps, 0.0).astype(np.float64), disks * (0.4 * LAMP + 0.4 * FLASH))

    assert found is not None
    np.testing.assert_allclose(found.no_flash, SHAKEN, atol=0.2)


@pytest.mark.parametrize("entry", [1e3, np.inf, np.nan])
@pytest.mark.parametrize("where", ["covariance", "mean"])
def test_a_blur_that_no_hand_makes_is_chance(
    monkeypatch: pytest.MonkeyPatch, where: str, entry: float
) -> None:
    """And no kernel is made of it, which would be huge."""
    absurd = replace(_NOTHING, **{where: np.full_like(getattr(_NOTHING, where), entry)})
    monkeypatch.setattr("pipeline.pair.relative_blur._difference", lambda *_: absurd)

    assert told(*photographs(no_flash=SHAKEN)) is None


def test_photographs_of_noise_alone_tell_nothing() -> None:
    one, other = np.random.default_rng(4).uniform(0.1, 0.9, (2, HEIGHT, WIDTH, 3))

    assert told(one, other) is None


def test_unusable_photographs_and_small_ones_tell_nothing() -> None:
    lamps, both = photographs(no_flash=SHAKEN)

    assert told(lamps, both, np.ones((HEIGHT, WIDTH), bool)) is None
    assert told(lamps[:9, :9], both[:9, :9]) is None


@pytest.mark.parametrize("shape", [(1, 5), (2, 2), (3, 9)])
def test_pictures_of_a_few_blocks_tell_nothing(shape: tuple[int, int]) -> None:
    light, nothing = np.full((*shape, 3), 0.2), np.zeros((*shape, 3))
    few = Ratios(light, nothing, nothing + 0.01, np.ones(shape, np.bool_), 1)

    assert find_relative_blur(few, np.zeros(shape, np.bool_)) is None


def test_stripes_tell_of_the_blur_across_them() -> None:
    lamps, both = (np.repeat(light[:1], HEIGHT, axis=0) for light in photographs())
    level = blurred(lamps.astype(np.float32), blur_kernel(np.diag([1.0, 0.0])))

    found = told(level.astype(np.float64), both)

    assert found is not None
    assert found.no_flash[0, 0] == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("offset", [(1.0, -1.0), (-0.4, 0.3)])
def test_what_laying_on_one_end_of_a_shake_has_left_is_told(offset: tuple[float, float]) -> None:
    """Parts of a pixel were interpolated, which blurs the flash photograph a little."""
    lamps, both = photographs(no_flash=4 * SHAKEN)
    moved = blur_kernel(SHARP, -np.array(offset))
    laid = blurred(both.astype(np.float32), moved)

    found = told(lamps, laid.astype(np.float64))

    assert found is not None
    part = np.abs(offset) % 1
    expected = 4 * SHAKEN - np.diag(part * (1 - part))
    np.testing.assert_allclose(found.offset, offset, atol=0.05)
    np.testing.assert_allclose(found.no_flash, expected, rtol=0.1)
    back = blurred(laid, found.for_flash)
    alike = blurred(both.astype(np.float32), blur_kernel(4 * SHAKEN))
    inside = slice(20, -20), slice(20, -20)
    assert np.abs(back - alike)[inside].mean() < 0.01 * alike.mean()


def test_photographs_that_lie_on_each_other_have_no_offset() -> None:
    found = told(*photographs(no_flash=SHAKEN))

    assert found is not None
    np.testing.assert_allclose(found.offset, 0, atol=0.05)


@pytest.mark.parametrize("mean", [(0.0, 0.0), (2.5, -0.75), (-3.0, 1.2)])
@pytest.mark.parametrize(
    "covariance",
    [SHARP, np.diag([0.2, 0.1]), SHAKEN, np.array([[36.0, 20.0], [20.0, 30.0]])],
    ids=["none", "below a pixel", "a pixel", "six pixels"],
)
def test_kernels_have_the_mean_and_covariance_asked_for(
    covariance: Floats64, mean: tuple[float, float]
) -> None:
    """But for a covariance below what parts of pixels add to it."""
    kernel = blur_kernel(covariance, np.array(mean)).astype(np.float64)

    reach = len(kernel) // 2
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    u, v = x - mean[0], y - mean[1]
    moments = np.array([[(kernel * one * two).sum() for one in (u, v)] for two in (u, v)])
    assert kernel.sum() == pytest.approx(1)
    np.testing.assert_allclose([(kernel * x).sum(), (kernel * y).sum()], mean, atol=1e-3)
    if mean == (0.0, 0.0) or covariance[0, 0] >= 1:
        np.testing.assert_allclose(moments, covariance, rtol=2e-3, atol=1e-6)
    assert np.trace(moments) <= np.trace(covariance) + 0.5


def test_a_blur_is_in_memory_of_its_own_and_keeps_even_light() -> None:
    even = np.full((20, 30, 3), 0.25, np.float32)

    found = blurred(even, blur_kernel(SHAKEN))

    np.testing.assert_allclose(found, even, rtol=1e-6)
    assert not np.shares_memory(found, even)


def test_a_photograph_that_nobody_else_holds_is_written_over() -> None:
    light = np.random.default_rng(1).random((60, 50, 3), np.float32)
    for kernel in (blur_kernel(SHAKEN), blur_kernel(9 * SHAKEN)):
        expected, mine = blurred(light, kernel), light.copy()

        found = blurred(mine, kernel, own=True)

        assert np.shares_memory(found, mine)
        np.testing.assert_array_equal(found, expected)


def test_code_values_stay_as_they_are() -> None:
    codes = np.random.default_rng(1).integers(0, 256, (20, 30, 3), np.uint8)
    coded = TableImage(codes.copy(), np.linspace(0, 1, 256, dtype=np.float32))

    found = blurred(coded, blur_kernel(SHAKEN), own=True)

    np.testing.assert_allclose(found, blurred(coded[:], blur_kernel(SHAKEN)), atol=1e-6)
    np.testing.assert_array_equal(coded[:], codes / np.float32(255))


@pytest.mark.parametrize(
    ("covariance", "several"), [(np.diag([2.0, 0.1]), True), (np.diag([9.0, 9.0]), False)]
)
def test_pixels_that_unusable_ones_were_blurred_into_are_unusable(
    covariance: Floats64, several: bool
) -> None:
    """And these themselves, also where a wide blur leaves less than a tenth of them anywhere."""
    unusable = np.zeros((31, 31), bool)
    unusable[15, 15] = True
    kernel = blur_kernel(covariance)

    found = blurred_mask(unusable, kernel)

    expected = np.zeros_like(unusable)
    reach = min(len(kernel) // 2, 15)
    around = slice(len(kernel) // 2 - reach, len(kernel) // 2 + reach + 1)
    there = slice(15 - reach, 16 + reach)
    expected[there, there] = kernel[around, around] > 0.1
    expected[15, 15] = True
    np.testing.assert_array_equal(found, expected)
    assert (found.sum() > 1) == several
