from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.noise import HALO, Noise, estimate_noise, sigma_filter

Image = NDArray[np.float32]
Array = NDArray[np.float64]

GAIN, FLOOR = 2e-4, 2e-6
NOISE = Noise(np.full(3, GAIN), np.full(3, FLOOR))


def wedge(height: int = 256, width: int = 256) -> Array:
    """A smooth picture from dark to bright."""
    return np.broadcast_to(np.linspace(0.02, 0.8, width)[None, :, None], (height, width, 3)).copy()


def noisy(light: Array, seed: int = 0, gain: float = GAIN, floor: float = FLOOR) -> Image:
    """The picture with white noise of variance gain·I + floor."""
    deviation = np.sqrt(gain * light + floor)
    drawn = np.random.default_rng(seed).normal(size=light.shape)
    return np.asarray(light + drawn * deviation, dtype=np.float32)


@pytest.mark.parametrize(
    ("gain", "floor"), [(1e-3, 1e-5), (1e-4, 1e-6), (1e-5, 1e-6), (1e-8, 1e-4), (4e-4, 1e-9)]
)
def test_variance_of_white_noise_is_found(gain: float, floor: float) -> None:
    """Within 15 % in every channel, 8 % together: what 1024 blocks of each can tell."""
    found = estimate_noise(noisy(wedge(), gain=gain, floor=floor))

    for level in (0.05, 0.2, 0.6):
        ratio = found.variance(np.full(3, level)) / (gain * level + floor)
        np.testing.assert_allclose(ratio, 1, atol=0.15)
        assert ratio.mean() == pytest.approx(1, abs=0.08)
    assert found.grain == 1


FULL_WELL, READ_NOISE = 20_000, 5.0
"""Electrons of the sensor whose noise is to be found."""


def counted(light: Array, exposure: float, seed: int = 0) -> Image:
    """The picture as a 14-bit sensor counts it, brought back to full exposure."""
    rng = np.random.default_rng(seed)
    electrons = rng.poisson(light * exposure * FULL_WELL) + rng.normal(0, READ_NOISE, light.shape)
    codes = np.rint(electrons / FULL_WELL * 16383) / 16383
    return np.asarray(codes / exposure, dtype=np.float32)


@pytest.mark.parametrize("exposure", [1, 1 / 2, 1 / 4, 1 / 8])
@pytest.mark.parametrize("size", [(192, 256), (800, 1200)])
def test_noise_of_a_sensor_is_found_among_patches(size: tuple[int, int], exposure: float) -> None:
    """Patches of 24 pixels with slanted edges and shading, at any exposure: within 12 %."""
    height, width = size
    rng = np.random.default_rng(6)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    patches = rng.uniform(0.03, 0.9, (height // 12, width // 12, 3))
    row, column = ((0.95 * y + 0.3 * x) / 24).astype(int), ((0.95 * x - 0.3 * y) / 24).astype(int)
    light = patches[row % len(patches), column % (width // 12)] * (0.4 + 0.6 * x / width)[..., None]

    found = estimate_noise(counted(light, exposure))

    for level in (0.05, 0.2, 0.6):
        expected = level / (FULL_WELL * exposure) + (READ_NOISE / (FULL_WELL * exposure)) ** 2
        ratio = found.variance(np.full(3, level)).mean() / expected
        assert ratio == pytest.approx(1, abs=0.12)
    assert found.grain == 1


def test_a_clean_picture_of_patches_has_no_noise() -> None:
    """A thousandth of the noise of a sensor at most, in spite of its texture."""
    patches = np.kron(np.random.default_rng(2).uniform(0.1, 0.9, (12, 16)), np.ones((16, 16)))
    light = np.asarray(cv2.GaussianBlur(patches, (0, 0), 0.6)[..., None] * np.ones(3), np.float32)

    found = estimate_noise(light).variance(np.full(3, 0.4))

    assert (found < 1e-3 * 0.4 / FULL_WELL).all()


def test_blocks_without_any_noise_do_not_make_the_others_quiet() -> None:
    """As in JPEG, which empties some blocks: three in five here."""
    light = wedge()
    empty = np.random.default_rng(4).uniform(size=(32, 32)) < 0.6
    drawn = noisy(light) - light

    found = estimate_noise(
        np.asarray(light + drawn * ~np.kron(empty, np.ones((8, 8), bool))[..., None], np.float32)
    )

    assert (found.variance(np.full(3, 0.4)) < GAIN * 0.4 + FLOOR).all()


def test_channels_have_their_own_noise() -> None:
    light = wedge()
    planes = [
        noisy(light, seed=k, gain=gain, floor=1e-7)[..., 0]
        for k, gain in enumerate([1e-4, 4e-4, 16e-4])
    ]

    found = estimate_noise(np.stack(planes, axis=-1)).variance(np.full(3, 0.4))

    assert 3 < found[1] / found[0] < 5
    assert 3 < found[2] / found[1] < 5


def test_texture_does_not_count_as_noise() -> None:
    """Every other patch of the picture is busy."""
    light = wedge()
    busy = np.kron(np.indices((8, 8)).sum(axis=0) % 2, np.ones((32, 32)))[..., None]
    stripes = 1 + 0.4 * busy * (np.indices((256, 256)).sum(axis=0)[..., None] % 4 < 2)

    found = estimate_noise(noisy(light * stripes)).variance(np.full(3, 0.4))

    assert (found / (GAIN * 0.4 + FLOOR) > 0.85).all()
    assert (found / (GAIN * 0.4 + FLOOR) < 1.5).all()


def blurred(sigma: float) -> Array:
    """Noise that hangs together over some pixels, as after denoising."""
    drawn = np.random.default_rng(1).normal(0, 0.02, (256, 256, 3))
    return np.asarray(cv2.GaussianBlur(drawn, (0, 0), sigma))


@pytest.mark.parametrize("sigma", [0.7, 1.0, 1.5])
def test_noise_that_hangs_together_has_grain(sigma: float) -> None:
    found = estimate_noise(np.asarray(wedge() + blurred(sigma), dtype=np.float32))

    assert found.grain > 4


@pytest.mark.parametrize("sigma", [0.7, 1.0])
def test_noise_that_hides_from_neighbours_is_seen_in_means(sigma: float) -> None:
    """Single pixels look quiet, but means of 16 do not: their variance is right to a factor 5."""
    light = blurred(sigma)

    found = estimate_noise(np.asarray(wedge() + light, dtype=np.float32))

    means = cv2.resize(light, (64, 64), interpolation=cv2.INTER_AREA).var()
    ratio = found.variance(np.full(3, 0.4), 16).mean() / means
    assert 1 / 5 < ratio < 5


@pytest.mark.parametrize("size", [(8, 8), (32, 32), (40, 200), (65, 64)])
@pytest.mark.parametrize("value", [0.0, 0.3, 1.0, -0.01])
def test_pictures_without_noise_have_next_to_none(size: tuple[int, int], value: float) -> None:
    found = estimate_noise(np.full((*size, 3), value, np.float32))

    assert (found.variance(np.full(3, 0.5)) < 1e-7).all()
    assert (found.variance(np.full(3, 0.5)) > 0).all()


def test_variance_is_a_line_over_brightness_and_flat_below_black() -> None:
    found = NOISE.variance(np.array([[0.0, 0.5, 1.0], [-0.3, -1.0, 2.0]]))

    expected = GAIN * np.array([[0.0, 0.5, 1.0], [0.0, 0.0, 2.0]]) + FLOOR
    np.testing.assert_allclose(found, expected)


@pytest.mark.parametrize(
    ("grain", "averaged", "factor"), [(1, 1, 1), (1, 16, 1 / 16), (4, 16, 1 / 4), (4, 2, 1)]
)
def test_means_of_pixels_have_less_noise_beyond_the_grain(
    grain: float, averaged: float, factor: float
) -> None:
    noise = Noise(np.full(3, GAIN), np.full(3, FLOOR), grain)
    pixels = np.full(3, 0.4)

    found = noise.variance(pixels, averaged)

    np.testing.assert_allclose(found, factor * noise.variance(pixels))


def test_stabilized_noise_has_variance_one_everywhere() -> None:
    stable = NOISE.stabilize(noisy(wedge(600, 60)))

    variances = stable.var(axis=0)
    assert variances.mean() == pytest.approx(1, abs=0.02)
    assert variances[:5].mean() == pytest.approx(1, abs=0.15)
    assert variances[-5:].mean() == pytest.approx(1, abs=0.15)


def filtered(pair: tuple[Image, Image], rows: int | None = None) -> tuple[Image, Image]:
    """Filter a pair in strips of so many rows, each with its halo."""
    height = len(pair[0])
    step = rows or height
    strips = []
    for top in range(0, height, step):
        first, last = max(top - HALO, 0), min(top + step + HALO, height)
        keep = slice(top - first, min(top + step, height) - first)
        part = (pair[0][first:last], pair[1][first:last])
        strips.append(sigma_filter(part, (NOISE, NOISE), keep)[:2])
    before, after = zip(*strips, strict=True)
    return np.concatenate(before), np.concatenate(after)


@pytest.fixture
def edge() -> tuple[Array, Array]:
    """Two pictures with the same edge down the middle, brighter on the left."""
    bright = np.full((64, 96, 3), 0.4)
    bright[:, 48:] = 0.2
    return bright, 1.5 * bright


def test_noise_of_flat_areas_is_lowered_fifteenfold(edge: tuple[Array, Array]) -> None:
    pair = noisy(edge[0], 1), noisy(edge[1], 2)

    found = filtered(pair)

    for before, after, true in zip(pair, found, edge, strict=True):
        inner = (slice(8, -8), slice(8, 40))
        left = np.sqrt(np.median(np.square((after - true)[inner])))
        assert left < np.sqrt(np.median(np.square((before - true)[inner]))) / 15
        assert after[inner].mean() == pytest.approx(true[inner].mean(), rel=2e-3)


def test_edges_stay_sharp(edge: tuple[Array, Array]) -> None:
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


@pytest.mark.parametrize("rows", [1, 5, 23, 40])
def test_rows_may_be_cut_anywhere(edge: tuple[Array, Array], rows: int) -> None:
    pair = noisy(edge[0], 1), noisy(edge[1], 2)

    whole, cut = filtered(pair), filtered(pair, rows)

    for one, other in zip(whole, cut, strict=True):
        np.testing.assert_array_equal(other, one)


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


def test_noise_of_means() -> None:
    white, grainy = Noise(NOISE.gain, NOISE.floor), Noise(NOISE.gain, NOISE.floor, grain=8.0)

    np.testing.assert_allclose(white.of_means(4).floor, NOISE.floor / 16)
    np.testing.assert_allclose(grainy.of_means(4).gain, NOISE.gain / 2)
    np.testing.assert_allclose(grainy.of_means(2).gain, NOISE.gain)
    assert grainy.of_means(2).grain == 2
