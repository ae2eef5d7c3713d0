from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.images.frames import Image
from pipeline.images.noise import Noise
from pipeline.images.sigma_filter import ROUNDS, SigmaFilter, sigma_filter
from pipeline.images.strips import widened

GAIN, FLOOR = 2e-4, 2e-6
NOISE = Noise(np.full(3, GAIN), np.full(3, FLOOR))
LOUDER = Noise(np.array([1, 2, 3]) * GAIN, np.array([3, 2, 1]) * FLOOR)


def noisy(light: Floats64, seed: int) -> Image:
    normal = np.random.default_rng(seed).normal(size=light.shape)
    return np.asarray(light + normal * np.sqrt(GAIN * light + FLOOR), dtype=np.float32)


def defined(images: tuple[Image, Image], noises: tuple[Noise, Noise], rounds: int = 4) -> Floats64:
    """The filter as it is defined, pixel by pixel: the average of those that join, (h, W, 7)."""
    values = np.concatenate(images, axis=2).astype(np.float64)
    height, width = values.shape[:2]
    averaged = np.ones((height, width))
    gain, floor = (np.concatenate([getattr(n, name) for n in noises]) for name in ("gain", "floor"))
    for gap in (1, 2, 5, 12)[:rounds]:
        stable = 2 / gain * np.sqrt(gain * np.maximum(values, 0) + floor)
        sums, counts = np.zeros_like(values), np.zeros_like(averaged)
        offsets = gap * np.arange(-1, 2)
        for y in range(height):
            for x in range(width):
                ys, xs = np.meshgrid(y + offsets, x + offsets, indexing="ij")
                inside = (ys >= 0) & (ys < height) & (xs >= 0) & (xs < width)
                around = ys[inside], xs[inside]
                alike = np.square(stable[around] - stable[y, x]).sum(axis=1) < 4.2**2
                weight = np.where(alike, averaged[around], 0.0)
                sums[y, x] = weight @ values[around]
                counts[y, x] = weight.sum()
        values, averaged = sums / counts[..., None], counts
    return np.concatenate([values, averaged[..., None]], axis=2)


@pytest.mark.parametrize("size", [(30, 37), (5, 40), (26, 3)])
def test_the_filter_is_what_it_is_defined_to_be(size: tuple[int, int]) -> None:
    light = np.random.default_rng(5).choice([0.2, 0.25, 0.6], size)[..., None] * np.ones(3)
    pair = noisy(light, 1), noisy(0.5 * light, 2)

    first, second, averaged = sigma_filter(pair, (NOISE, LOUDER))

    found = np.concatenate([first, second, averaged[..., None]], axis=2)
    np.testing.assert_allclose(found, defined(pair, (NOISE, LOUDER)), rtol=2e-5)


@pytest.mark.parametrize("rounds", [1, 2])
def test_fewer_rounds_are_the_first_ones(rounds: int) -> None:
    light = np.random.default_rng(5).choice([0.2, 0.25, 0.6], (20, 30))[..., None] * np.ones(3)
    pair = noisy(light, 1), noisy(0.5 * light, 2)

    found = np.concatenate(filtered(pair, 7, rounds), axis=2)

    np.testing.assert_allclose(found, defined(pair, (NOISE, NOISE), rounds)[..., :6], rtol=2e-5)


def filtered(
    pair: tuple[Image, Image], rows: int | None = None, rounds: int = ROUNDS, around: int = 0
) -> tuple[Image, Image]:
    """Filter a pair in strips of so many rows, each asked for with some rows around it."""
    height, width = pair[0].shape[:2]
    step = rows or height

    def read(some: slice, planes: Image) -> None:
        planes[...] = np.moveaxis(np.concatenate([one[some] for one in pair], axis=2), -1, 0)

    one = SigmaFilter(read, (width, height), (NOISE, NOISE), rounds)
    strips = []
    for top in range(0, height, step):
        wide, inner = widened(slice(top, min(top + step, height)), around, height)
        before, after, _ = one.rows(wide)
        strips.append((before[inner], after[inner]))
    firsts, seconds = zip(*strips, strict=True)
    return np.concatenate(firsts), np.concatenate(seconds)


@pytest.fixture
def edge() -> tuple[Floats64, Floats64]:
    """Two pictures with the same edge down the middle, brighter on the left."""
    bright = np.full((64, 96, 3), 0.4)
    bright[:, 48:] = 0.2
    return bright, 1.5 * bright


def test_noise_of_flat_areas_is_lowered_fifteenfold(edge: tuple[Floats64, Floats64]) -> None:
    pair = noisy(edge[0], 1), noisy(edge[1], 2)

    found = filtered(pair)

    for before, after, true in zip(pair, found, edge, strict=True):
        inner = (slice(8, -8), slice(8, 40))
        left = np.sqrt(np.median(np.square((after - true)[inner])))
        assert left < np.sqrt(np.median(np.square((before - true)[inner]))) / 15
        assert after[inner].mean() == pytest.approx(true[inner].mean(), rel=2e-3)


def test_edges_stay_sharp(edge: tuple[Floats64, Floats64]) -> None:
    found = filtered((noisy(edge[0], 1), noisy(edge[1], 2)))

    for after, true in zip(found, edge, strict=True):
        beside = (slice(None), slice(46, 50))
        assert np.abs(after - true)[beside].mean() < 0.02 * 0.2


def test_an_edge_in_one_photograph_alone_is_kept_in_both() -> None:
    """The pair decides together which pixels are alike, so a shadow of the flash stays one."""
    flat = np.full((64, 96, 3), 0.3)
    shadow = flat.copy()
    shadow[:, 48:] = 0.2

    _, found = filtered((noisy(flat, 1), noisy(shadow, 2)))

    assert np.abs(found - shadow)[:, 46:50].mean() < 0.02 * 0.1


def test_single_pixels_far_beyond_the_noise_are_kept() -> None:
    flat = np.full((40, 40, 3), 0.3, np.float32)
    flat[20, 20] = 0.9

    found, _ = filtered((flat, flat))

    np.testing.assert_allclose(found, flat, atol=1e-5)


@pytest.mark.parametrize("around", [0, 2, 30])
@pytest.mark.parametrize("rows", [1, 5, 23, 40])
def test_rows_may_be_cut_anywhere(edge: tuple[Floats64, Floats64], rows: int, around: int) -> None:
    pair = noisy(edge[0], 1), noisy(edge[1], 2)

    whole, cut = filtered(pair), filtered(pair, rows, around=around)

    for one, other in zip(whole, cut, strict=True):
        np.testing.assert_array_equal(other, one)


def test_every_row_is_read_once_but_for_those_around() -> None:
    read: list[int] = []

    def reading(rows: slice, planes: Image) -> None:
        read.append(rows.stop - rows.start)
        planes[...] = 0.4

    one = SigmaFilter(reading, (8, 100), (NOISE, NOISE))
    for top in range(0, 100, 20):
        one.rows(slice(top, top + 20))

    assert sum(read) <= 100 + 4 * 1 * 2  # the first window's reach on either side of four borders


@pytest.mark.parametrize("size", [(1, 1), (3, 50), (50, 2)])
def test_pictures_smaller_than_the_window_are_averaged_too(size: tuple[int, int]) -> None:
    light = np.full((*size, 3), 0.3)

    found, _ = filtered((noisy(light, 1), noisy(light, 2)))

    assert found.shape == (*size, 3)
    assert np.abs(found - 0.3).max() < 5 * np.sqrt(GAIN * 0.3 + FLOOR)


def test_black_and_negative_pixels_stay_finite() -> None:
    dark = np.random.default_rng(3).normal(0, np.sqrt(FLOOR), (30, 30, 3)).astype(np.float32)

    found, other = filtered((dark, -dark))

    assert np.abs(found).max() <= np.abs(dark).max()
    assert np.isfinite(other).all()


def test_the_filter_says_how_many_pixels_it_averaged() -> None:
    """All of the windows' where everything is alike, one where nothing is."""
    flat = np.full((48, 48, 3), 0.4, np.float32)
    loud = np.random.default_rng(0).uniform(0, 1, (48, 48, 3)).astype(np.float32)

    *_, averaged = sigma_filter((flat, flat), (NOISE, NOISE))
    *_, alone = sigma_filter((loud, loud[::-1].copy()), (NOISE, NOISE))

    assert averaged[24, 24] > 1000
    assert np.median(alone) == 1
