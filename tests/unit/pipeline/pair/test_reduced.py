from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats32
from pipeline.images.noise import Noise
from pipeline.pair.misregistration import softened
from pipeline.pair.reduced import reduce_pair, unusable_where


def even(height: int, width: int, value: float) -> Floats32:
    return np.full((height, width, 3), value, np.float32)


def lively(height: int, width: int, block: int = 2) -> Floats32:
    """Blocks of which none is like another, so that only their own pixels are averaged."""
    drawn = np.random.default_rng(1).uniform(0.2, 0.4, (height // block, width // block, 3))
    return np.asarray(drawn.repeat(block, axis=0).repeat(block, axis=1), dtype=np.float32)


@pytest.mark.parametrize(
    ("size", "block", "reduced"),
    [
        ((64, 96), 1, (64, 96)),
        ((512, 40), 1, (512, 40)),
        ((40, 513), 2, (20, 256)),
        ((35, 1030), 3, (11, 343)),
        ((1, 1537), 4, (1, 384)),
    ],
)
def test_the_longer_side_has_at_most_512_blocks(
    pair_of: Callable[..., Any], size: tuple[int, int], block: int, reduced: tuple[int, int]
) -> None:
    found = reduce_pair(pair_of(even(*size, 0.3), even(*size, 0.2)))

    assert found.block == block
    for picture in (found.no_flash, found.flash, found.no_flash_variance, found.flash_variance):
        assert picture.shape == (*reduced, 3)
        assert picture.dtype == np.float32
    assert found.usable.shape == reduced
    middle = (np.array(size[::-1]) / 2 - 0.5 - (block - 1) / 2) / block
    np.testing.assert_allclose(found.middle, middle)


def test_blocks_are_means(pair_of: Callable[..., Any]) -> None:
    rng = np.random.default_rng(1)
    no_flash, part = rng.uniform(0.1, 0.6, (2, 8, 1030, 3)).astype(np.float32)

    found = reduce_pair(pair_of(no_flash, part))

    for picture, whole in ((found.no_flash, no_flash), (found.flash, part)):
        expected = whole[:6, :1029].reshape(2, 3, 343, 3, 3).mean(axis=(1, 3))
        np.testing.assert_allclose(picture, expected, atol=1e-5)


def test_a_flash_part_given_alone_is_taken_as_it_is(pair_of: Callable[..., Any]) -> None:
    no_flash, part = even(40, 60, 0.5), even(40, 60, 0.2)

    found = reduce_pair(pair_of(no_flash, part, flash_only=True))

    np.testing.assert_allclose(found.flash, part, rtol=1e-6)
    assert found.usable.all()


def test_clipped_pixels_are_left_out(pair_of: Callable[..., Any]) -> None:
    no_flash, part = even(8, 1024, 0.3), even(8, 1024, 0.2)
    clipped = np.zeros((8, 1024), bool)
    clipped[0, 0] = clipped[3, 5] = clipped[4, 9] = clipped[5, 8] = True
    for picture in (no_flash, part):
        picture[clipped] = 7.0

    found = reduce_pair(pair_of(no_flash, part, unusable=clipped))

    assert found.block == 2
    assert found.usable.all()
    np.testing.assert_allclose(found.no_flash, 0.3, rtol=1e-5)
    np.testing.assert_allclose(found.flash, 0.2, rtol=1e-5)


def test_blocks_that_are_mostly_clipped_are_not_used(pair_of: Callable[..., Any]) -> None:
    clipped = np.zeros((8, 1024), bool)
    clipped[:2, :2] = True
    clipped[2:4, 2:3] = True
    clipped[4, 4] = True
    clipped[6:8, 6] = clipped[6, 7] = True

    found = reduce_pair(pair_of(even(8, 1024, 0.3), even(8, 1024, 0.2), unusable=clipped))

    assert found.block == 2
    np.testing.assert_array_equal(np.argwhere(~found.usable), [[0, 0], [3, 3]])


def test_every_pixel_clipped_leaves_nothing_to_use(pair_of: Callable[..., Any]) -> None:
    pair = pair_of(even(40, 60, 0.9), even(40, 60, 0.9), unusable=np.ones((40, 60), bool))

    found = reduce_pair(pair)

    assert not found.usable.any()
    assert np.isfinite(found.no_flash).all()
    assert np.isfinite(found.flash).all()


def rough(height: int, width: int, seed: int) -> Floats32:
    """A texture of which no two pixels are alike enough to be averaged."""
    drawn = np.random.default_rng(seed).uniform(0.1, 0.9, (height, width, 1))
    return np.repeat(drawn, 3, axis=2).astype(np.float32)


def test_variances_are_those_of_the_means(pair_of: Callable[..., Any]) -> None:
    gain, floor = np.array([1e-6, 2e-6, 3e-6]), np.full(3, 1e-8)
    pair = pair_of(
        rough(8, 1024, 1),
        rough(8, 1024, 2),
        no_flash_noise=Noise(gain, floor),
        flash_noise=Noise(2 * gain, floor),
    )

    found = reduce_pair(pair)

    no_flash = (found.no_flash * gain + floor) / 4
    np.testing.assert_allclose(found.no_flash_variance, no_flash, rtol=1e-4)
    whole = ((found.no_flash + found.flash) * 2 * gain + floor) / 4
    np.testing.assert_allclose(found.flash_variance, whole + no_flash, rtol=1e-4)


def test_noise_that_hangs_together_is_not_averaged_away(pair_of: Callable[..., Any]) -> None:
    grainy = Noise(np.full(3, 1e-6), np.full(3, 1e-8), grain=4.0)
    pair = pair_of(rough(8, 1024, 1), rough(8, 1024, 2), no_flash_noise=grainy)

    found = reduce_pair(pair)

    np.testing.assert_allclose(found.no_flash_variance, found.no_flash * 1e-6 + 1e-8, rtol=1e-4)


def test_noise_of_flat_areas_is_filtered(pair_of: Callable[..., Any]) -> None:
    """Means of four pixels with noise of 0.02: the filter takes most of what is left away."""
    noise = Noise(np.full(3, 1e-8), np.full(3, 4e-4))
    drawn = np.random.default_rng(0).normal(0.3, 0.02, (200, 1024, 3)).astype(np.float32)
    pair = pair_of(drawn, even(200, 1024, 0.2), no_flash_noise=noise, flash_noise=noise)

    found = reduce_pair(pair)

    assert np.std(found.no_flash) < 0.15 * 0.01
    assert np.median(found.no_flash_variance) < 0.02 * 1e-4


@pytest.mark.parametrize(
    ("noise", "rounds"),
    [(0.002, 0), (0.0045, 0), (0.006, 1), (0.014, 1), (0.016, 2), (0.04, 2), (0.05, 3), (0.3, 4)],
)
@pytest.mark.parametrize("flash_only", [False, True])
def test_noise_is_averaged_as_often_as_it_takes_to_leave_little(
    pair_of: Callable[..., Any], noise: float, rounds: int, flash_only: bool
) -> None:
    """Noise is relative, of flash part and light together; a black half does not count."""
    size = 64, 104
    no_flash, part = even(*size, 0.2), even(*size, 0.2)
    no_flash[:, :56] = part[:, :56] = 0.0
    squares = 2.0 if flash_only else 3.0  # the flash part is a difference of two photographs
    floor = np.full(3, 3 * (0.2 * noise) ** 2 / squares)
    exact = Noise(np.full(3, 1e-12), floor)
    pair = pair_of(no_flash, part, no_flash_noise=exact, flash_noise=exact, flash_only=flash_only)

    found = reduce_pair(pair)

    np.testing.assert_allclose(found.no_flash_variance[32, 79], floor / 9**rounds, rtol=1e-4)


@pytest.mark.parametrize(("noise", "rounds"), [(0.012, 0), (0.013, 1), (0.037, 1), (0.04, 2)])
def test_more_noise_is_left_in_rendered_photographs(
    pair_of: Callable[..., Any], noise: float, rounds: int
) -> None:
    floor = np.full(3, (0.2 * noise) ** 2)
    exact = Noise(np.full(3, 1e-12), floor)
    pair = pair_of(
        even(64, 104, 0.2),
        even(64, 104, 0.2),
        no_flash_noise=exact,
        flash_noise=exact,
        rendered=True,
    )

    found = reduce_pair(pair)

    np.testing.assert_allclose(found.no_flash_variance[32, 52], floor / 9**rounds, rtol=1e-4)


def test_light_that_changes_little_is_not_bent_where_there_is_little_noise(
    pair_of: Callable[..., Any],
) -> None:
    rng = np.random.default_rng(1)
    no_flash, part = rng.uniform(0.2, 0.2002, (2, 64, 96, 3)).astype(np.float32)
    noise = Noise(np.full(3, 1e-12), np.full(3, 2e-7))

    found = reduce_pair(pair_of(no_flash, part, no_flash_noise=noise, flash_noise=noise))

    np.testing.assert_array_equal(found.no_flash, no_flash)
    np.testing.assert_allclose(found.flash, part, atol=1e-7)


@pytest.mark.parametrize("dark", ["no_flash", "flash"])
def test_places_without_light_of_either_kind_are_not_used(
    pair_of: Callable[..., Any], dark: str
) -> None:
    no_flash, part = even(40, 60, 0.3), even(40, 60, 0.3)
    (no_flash if dark == "no_flash" else part)[10:20, 10:20] = 2e-4

    usable = reduce_pair(pair_of(no_flash, part)).usable

    expected = np.ones((40, 60), bool)
    expected[10:20, 10:20] = False
    np.testing.assert_array_equal(usable, expected)


def test_light_within_its_noise_is_not_used(pair_of: Callable[..., Any]) -> None:
    """A flash part of 0.02 a channel, with noise of 0.03 each that no averaging lessens."""
    loud = Noise(np.full(3, 1e-8), np.full(3, 9e-4), grain=1e6)
    part = even(40, 60, 0.02)
    part[:20] = 0.4

    usable = reduce_pair(pair_of(lively(40, 60, 1), part, flash_noise=loud)).usable

    assert usable[:20].all()
    assert not usable[20:].any()


def test_pixels_that_the_flash_made_darker_are_not_used(pair_of: Callable[..., Any]) -> None:
    part = even(40, 60, 0.2)
    part[5, 5, 2] = -0.01

    usable = reduce_pair(pair_of(even(40, 60, 0.3), part)).usable

    np.testing.assert_array_equal(np.argwhere(~usable), [[5, 5]])


def test_a_black_pair_has_nothing_to_use(pair_of: Callable[..., Any]) -> None:
    assert not reduce_pair(pair_of(even(40, 60, 0), even(40, 60, 0))).usable.any()


def test_edges_of_a_pair_laid_together_are_less_certain(pair_of: Callable[..., Any]) -> None:
    """Two fifths of the deviation count: at a step of 0.2, whose slope is 0.1 after softening."""
    part = even(40, 60, 0.2)
    part[:, 30:] = 0.4
    before = even(40, 60, 0.1)
    at_rest, laid = (
        reduce_pair(pair_of(before, part, registration_px=deviation)) for deviation in (0.0, 0.35)
    )

    added = np.sqrt(np.maximum(laid.flash_variance - at_rest.flash_variance, 0.0))

    soft = softened((before + part).astype(np.float32))[20, 28:32, 0]
    slopes = np.array([soft[2] - soft[0], soft[3] - soft[1]]) / 2
    np.testing.assert_allclose(added[20, 29:31, 0], 0.4 * 0.35 * slopes, rtol=1e-3)
    assert added[:, :20].max() < 1e-5


@pytest.mark.parametrize(("width", "offset"), [(60, 0.35), (600, 0.175)])
def test_the_offset_of_a_pair_laid_together_is_told_in_blocks(
    pair_of: Callable[..., Any], width: int, offset: float
) -> None:
    light = even(4, width, 0.2)

    assert reduce_pair(pair_of(light, light, registration_px=0.35)).offset == pytest.approx(offset)
    assert reduce_pair(pair_of(light, light, registration_px=0.0)).offset == 0


def test_edges_of_a_pair_laid_together_lie_where_they_are_without_the_flash(
    pair_of: Callable[..., Any],
) -> None:
    """A painted step under even light, the flash photograph half a pixel beside it."""
    paint, beside = even(40, 60, 0.2), even(40, 60, 0.2)
    paint[:, 30:] = beside[:, 30:] = 0.8
    beside[:, 29] = 0.5
    before, part = 0.5 * paint, beside

    def off(registration: float) -> float:
        reduced = reduce_pair(pair_of(before, part, registration_px=registration))
        return float(np.abs(np.log(reduced.flash / (2 * reduced.no_flash))).max())

    assert off(0.35) < 0.4 * off(0.0)


@pytest.mark.parametrize("rendered", [True, False])
def test_it_is_told_whether_a_rendering_has_bent_the_values(
    pair_of: Callable[..., Any], rendered: bool
) -> None:
    pair = pair_of(even(40, 60, 0.1), even(40, 60, 0.2), rendered=rendered)

    assert reduce_pair(pair).rendered is rendered


def test_pixels_of_blocks_become_unusable_beside_those_that_are(
    pair_of: Callable[..., Any],
) -> None:
    """Blocks of 3 × 3 pixels; the picture has two columns and a row more than these."""
    before = np.zeros((7, 11, 3), np.float32)
    unusable = np.zeros((7, 11), bool)
    unusable[6, 10] = True
    pair = pair_of(before, before, unusable=unusable.copy())
    blocks = np.array([[False, True, False], [False, False, True]])

    found = unusable_where(blocks, pair, 3).unusable

    expected = np.zeros((7, 11), bool)
    expected[:3, 3:6] = expected[3:6, 6:9] = expected[6, 10] = True
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(pair.unusable, unusable)


def test_a_picture_smaller_than_its_block_is_unusable_as_a_whole(
    pair_of: Callable[..., Any],
) -> None:
    before = np.zeros((2, 9, 3), np.float32)

    found = unusable_where(np.ones((1, 3), bool), pair_of(before, before), 3)

    assert found.unusable.all()
