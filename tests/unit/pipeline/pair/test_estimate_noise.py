from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.images.noise import Noise
from pipeline.pair.estimate_noise import _open_blocks, estimate_noises

Image = Floats32

GAIN, FLOOR = 2e-4, 2e-6
NOISE = Noise(np.full(3, GAIN), np.full(3, FLOOR))


def noise_of(photograph: Image) -> Noise:
    """Of a photograph beside one that shares nothing with it."""
    return estimate_noises(photograph, np.zeros_like(photograph))[0]


def wedge(height: int = 256, width: int = 256) -> Floats64:
    """A smooth picture from dark to bright."""
    return np.broadcast_to(np.linspace(0.02, 0.8, width)[None, :, None], (height, width, 3)).copy()


def noisy(light: Floats64, seed: int = 0, gain: float = GAIN, floor: float = FLOOR) -> Image:
    """The picture with white noise of variance gain·I + floor."""
    deviation = np.sqrt(gain * light + floor)
    drawn = np.random.default_rng(seed).normal(size=light.shape)
    return np.asarray(light + drawn * deviation, dtype=np.float32)


@pytest.mark.parametrize(
    ("gain", "floor"), [(1e-3, 1e-5), (1e-4, 1e-6), (1e-5, 1e-6), (1e-8, 1e-4), (4e-4, 1e-9)]
)
def test_variance_of_white_noise_is_found(gain: float, floor: float) -> None:
    """Within 15 % in every channel, 8 % together: what 1024 blocks of each can tell."""
    found = noise_of(noisy(wedge(), gain=gain, floor=floor))

    for level in (0.05, 0.2, 0.6):
        ratio = found.variance(np.full(3, level)) / (gain * level + floor)
        np.testing.assert_allclose(ratio, 1, atol=0.15)
        assert ratio.mean() == pytest.approx(1, abs=0.08)
    assert found.grain == 1


FULL_WELL, READ_NOISE = 20_000, 5.0
"""Electrons of the sensor whose noise is to be found."""


def counted(light: Floats64, exposure: float, seed: int = 0) -> Image:
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

    found = noise_of(counted(light, exposure))

    for level in (0.05, 0.2, 0.6):
        expected = level / (FULL_WELL * exposure) + (READ_NOISE / (FULL_WELL * exposure)) ** 2
        ratio = found.variance(np.full(3, level)).mean() / expected
        assert ratio == pytest.approx(1, abs=0.12)
    assert found.grain == 1


def test_a_clean_picture_of_patches_has_no_noise() -> None:
    """A thousandth of the noise of a sensor at most, in spite of its texture."""
    patches = np.kron(np.random.default_rng(2).uniform(0.1, 0.9, (12, 16)), np.ones((16, 16)))
    light = np.asarray(cv2.GaussianBlur(patches, (0, 0), 0.6)[..., None] * np.ones(3), np.float32)

    found = noise_of(light).variance(np.full(3, 0.4))

    assert (found < 1e-3 * 0.4 / FULL_WELL).all()


def test_blocks_without_any_noise_do_not_make_the_others_quiet() -> None:
    """As in JPEG, which empties some blocks: three in five here."""
    light = wedge()
    empty = np.random.default_rng(4).uniform(size=(32, 32)) < 0.6
    drawn = noisy(light) - light

    found = noise_of(
        np.asarray(light + drawn * ~np.kron(empty, np.ones((8, 8), bool))[..., None], np.float32)
    )

    assert (found.variance(np.full(3, 0.4)) < GAIN * 0.4 + FLOOR).all()


def test_channels_have_their_own_noise() -> None:
    light = wedge()
    planes = [
        noisy(light, seed=k, gain=gain, floor=1e-7)[..., 0]
        for k, gain in enumerate([1e-4, 4e-4, 16e-4])
    ]

    found = noise_of(np.stack(planes, axis=-1)).variance(np.full(3, 0.4))

    assert 3 < found[1] / found[0] < 5
    assert 3 < found[2] / found[1] < 5


def test_texture_does_not_count_as_noise() -> None:
    """Every other patch of the picture is busy."""
    light = wedge()
    busy = np.kron(np.indices((8, 8)).sum(axis=0) % 2, np.ones((32, 32)))[..., None]
    stripes = 1 + 0.4 * busy * (np.indices((256, 256)).sum(axis=0)[..., None] % 4 < 2)

    found = noise_of(noisy(light * stripes)).variance(np.full(3, 0.4))

    assert (found / (GAIN * 0.4 + FLOOR) > 0.85).all()
    assert (found / (GAIN * 0.4 + FLOOR) < 1.5).all()


def blurred(sigma: float) -> Floats64:
    """Noise that hangs together over some pixels, as after denoising."""
    drawn = np.random.default_rng(1).normal(0, 0.02, (256, 256, 3))
    return np.asarray(cv2.GaussianBlur(drawn, (0, 0), sigma))


@pytest.mark.parametrize("sigma", [0.7, 1.0, 1.5])
def test_noise_that_hangs_together_has_grain(sigma: float) -> None:
    found = noise_of(np.asarray(wedge() + blurred(sigma), dtype=np.float32))

    assert found.grain > 4


@pytest.mark.parametrize("sigma", [0.7, 1.0])
def test_noise_that_hides_from_neighbours_is_seen_in_means(sigma: float) -> None:
    """Single pixels look quiet, but means of 16 do not: their variance is right to a factor 5."""
    light = blurred(sigma)

    found = noise_of(np.asarray(wedge() + light, dtype=np.float32))

    means = cv2.resize(light, (64, 64), interpolation=cv2.INTER_AREA).var()
    ratio = found.variance(np.full(3, 0.4), 16).mean() / means
    assert 1 / 5 < ratio < 5


@pytest.mark.parametrize("size", [(8, 8), (32, 32), (40, 200), (65, 64)])
@pytest.mark.parametrize("value", [0.0, 0.3, 1.0, -0.01])
def test_pictures_without_noise_have_next_to_none(size: tuple[int, int], value: float) -> None:
    found = noise_of(np.full((*size, 3), value, np.float32))

    assert (found.variance(np.full(3, 0.5)) < 1e-7).all()
    assert (found.variance(np.full(3, 0.5)) > 0).all()


MIXED = np.array([[0.8, 0.1, 0.0], [0.05, 0.7, 0.05], [0.0, 0.1, 0.6]])
"""What lamps of another colour make of a surface's three channels."""


def textured(height: int = 256, width: int = 256, low: float = 0.05, high: float = 0.6) -> Floats64:
    """Another colour in every pixel, in light that gets less to one side."""
    colours = np.random.default_rng(8).uniform(low, high, (height, width, 3))
    return np.asarray(colours * np.linspace(1.0, 0.5, width)[None, :, None])


@pytest.mark.parametrize("size", [(192, 256), (1600, 1400)])
def test_noise_is_found_under_texture_that_the_other_photograph_shares(
    size: tuple[int, int],
) -> None:
    """No less than it is, and at most four times: the other's noise counts as well."""
    light = textured(*size, low=0.25, high=0.4)
    other = noisy(light @ MIXED.T, seed=1)

    found = estimate_noises(noisy(light), other)[0].variance(np.full(3, 0.3)) / (GAIN * 0.3 + FLOOR)

    assert (found > 0.85).all()
    assert (found < 4).all()
    assert (noise_of(noisy(light)).variance(np.full(3, 0.3)) > 10 * (GAIN * 0.3 + FLOOR)).all()


def faintly_textured(height: int, width: int) -> tuple[Floats32, Floats32]:
    """Both photographs of a texture that hides in the noise of single pixels, not of means."""
    drawn = np.random.default_rng(3).normal(0, 1, (height, width, 3))
    soft = cv2.GaussianBlur(drawn, (0, 0), 1.2)
    light = np.maximum(0.3 + 0.02 * soft / soft.std(), 0.0)
    return noisy(light, seed=1), noisy(light @ MIXED.T, seed=2)


@pytest.mark.parametrize("size", [(512, 640), (1600, 1400)])
def test_faint_texture_that_both_share_is_no_grain(size: tuple[int, int]) -> None:
    """Small pictures, and large ones of which tiles are looked at."""
    one, other = faintly_textured(*size)

    for found in estimate_noises(one, other):
        assert found.grain < 4
    assert noise_of(one).grain > 30


@pytest.mark.parametrize(("size", "shared"), [((128, 480), True), ((128, 464), False)])
def test_small_photographs_have_their_own_grain(size: tuple[int, int], shared: bool) -> None:
    """Of fewer than 240 blocks of 2 × 2 means, by which another explains more by chance."""
    one, other = faintly_textured(*size)

    for found, own in zip(estimate_noises(one, other), (one, other), strict=True):
        assert (found.grain < 0.5 * noise_of(own).grain) == shared
        assert (found.grain == noise_of(own).grain) != shared


def test_compressed_photographs_have_their_own_grain() -> None:
    one, other = faintly_textured(512, 640)

    found, _ = estimate_noises(one, other, compressed=True)

    assert found.grain == noise_of(one).grain


def test_texture_that_both_share_leaves_a_100th_of_its_variance() -> None:
    light = textured()
    one, other = (np.asarray(image, np.float32) for image in (light, light @ MIXED.T))
    level = np.full(3, 0.3)

    for pair in ((one, other), (other, one)):
        typical = np.median(pair[0].reshape(-1, 3), axis=0)
        left = estimate_noises(*pair)[0].variance(typical) / noise_of(pair[0]).variance(typical)
        np.testing.assert_allclose(left, 0.01, rtol=0.05)
        assert (estimate_noises(*pair)[0].variance(level) < noise_of(pair[0]).variance(level)).all()


def test_texture_that_lies_elsewhere_is_told_as_in_a_single_photograph() -> None:
    light = textured().astype(np.float32)

    found = estimate_noises(light, np.roll(light, 3, axis=1))[0]

    np.testing.assert_array_equal(found.gain, noise_of(light).gain)
    np.testing.assert_array_equal(found.floor, noise_of(light).floor)


@pytest.mark.parametrize("sigma", [None, 0.7, 1.0, 1.5])
def test_another_photograph_takes_nothing_from_bare_noise(sigma: float | None) -> None:
    """Not by chance either, however it hangs together."""
    one, other = (
        np.asarray(wedge() + (drawn if sigma is None else cv2.GaussianBlur(drawn, (0, 0), sigma)))
        for drawn in np.random.default_rng(9).normal(0, 0.02, (2, 256, 256, 3))
    )
    one, other = one.astype(np.float32), other.astype(np.float32)

    found, _ = estimate_noises(one, other)

    np.testing.assert_array_equal(found.gain, noise_of(one).gain)
    assert found.grain == noise_of(one).grain


def test_both_photographs_are_told_at_once() -> None:
    loud, quiet = noisy(wedge(), 1), noisy(wedge(), 2, gain=GAIN / 4, floor=FLOOR / 4)

    first, second = estimate_noises(loud, quiet)
    other_way = estimate_noises(quiet, loud)

    np.testing.assert_array_equal(first.gain, other_way[1].gain)
    np.testing.assert_array_equal(second.floor, other_way[0].floor)
    level = np.full(3, 0.3)
    np.testing.assert_allclose(first.variance(level) / second.variance(level), 4.0, rtol=0.15)


@pytest.mark.parametrize(("height", "width"), [(256, 256), (1200, 2000)])
@pytest.mark.parametrize("share", [0.03, 0.1, 0.4])
def test_clipped_areas_do_not_seem_to_have_no_noise(height: int, width: int, share: float) -> None:
    """Small pictures, and large ones of which tiles are looked at."""
    light = wedge(height, width)
    one, other = noisy(light, 1), noisy(light, 2)
    clipped = np.zeros((height, width), bool)
    clipped[: round(share * height)] = True
    one[clipped] = other[clipped] = 1.0

    found, _ = estimate_noises(one, other, clipped)

    for level in (0.05, 0.2, 0.6):
        ratio = found.variance(np.full(3, level)) / (GAIN * level + FLOOR)
        np.testing.assert_allclose(ratio, 1, atol=0.15)
    assert found.grain == 1


@pytest.mark.parametrize("width", [10, 20, 60])
@pytest.mark.parametrize("value", [0.0, 0.02, 0.8])
def test_a_frame_drawn_around_both_does_not_make_the_picture_quiet(
    width: int, value: float
) -> None:
    one, other = (np.full((256 + 2 * width,) * 2 + (3,), value, np.float32) for _ in range(2))
    inside = slice(width, -width)
    one[inside, inside], other[inside, inside] = noisy(wedge(), 1), noisy(wedge(), 2)

    found, _ = estimate_noises(one, other)

    for level in (0.05, 0.2, 0.6):
        ratio = found.variance(np.full(3, level)) / (GAIN * level + FLOOR)
        np.testing.assert_allclose(ratio, 1, atol=0.15)
    assert found.grain == 1


def test_a_frame_drawn_around_large_photographs_does_not_make_them_quiet() -> None:
    one, other = noisy(wedge(1200, 2000), 1), noisy(wedge(1200, 2000), 2)
    for photograph in (one, other):
        photograph[:200] = photograph[-200:] = 0.8

    found, _ = estimate_noises(one, other)

    for level in (0.05, 0.2, 0.6):
        ratio = found.variance(np.full(3, level)) / (GAIN * level + FLOOR)
        np.testing.assert_allclose(ratio, 1, atol=0.15)


def test_clipped_areas_do_not_count_among_those_that_are_like_the_quiet_ones() -> None:
    """Two fifths of what is open are quiet: too few for the others to be laid beside their line."""
    light = wedge(600)
    times = np.where(np.arange(600) // 8 % 15 < 6, 1, 40)[:, None, None]
    one, other = (
        np.asarray(light + times * (noisy(light, seed) - light), np.float32) for seed in (1, 2)
    )
    level = np.full(3, 0.4)
    whole = estimate_noises(one, other)[0].variance(level)
    clipped = np.zeros((600, 256), bool)
    clipped[:352] = True
    one[clipped] = other[clipped] = 1.0

    found, _ = estimate_noises(one, other, clipped)

    np.testing.assert_allclose(found.variance(level) / whole, 1, atol=0.05)


def test_where_nearly_all_is_clipped_all_of_it_is_looked_at() -> None:
    one, other = noisy(wedge(), 1), noisy(wedge(), 2)
    clipped = np.ones((256, 256), bool)
    clipped[:32, :32] = False

    found, _ = estimate_noises(one, other, clipped)

    np.testing.assert_array_equal(found.gain, estimate_noises(one, other)[0].gain)


def test_clipped_areas_hide_no_noise_that_hangs_together() -> None:
    """Means of 2 × 2 pixels tell its level, larger ones its grain, as in the whole picture."""
    one, other = (
        np.asarray(wedge() + cv2.GaussianBlur(drawn, (0, 0), 1.0), np.float32)
        for drawn in np.random.default_rng(9).normal(0, 0.02, (2, 256, 256, 3))
    )
    whole, _ = estimate_noises(one, other)
    clipped = np.zeros((256, 256), bool)
    clipped[:140] = True
    one[clipped] = other[clipped] = 1.0

    found, _ = estimate_noises(one, other, clipped)

    level = np.full(3, 0.3)
    np.testing.assert_allclose(found.variance(level) / whole.variance(level), 1, atol=0.2)
    assert found.grain / whole.grain == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize(("side", "hidden"), [(8, 4), (16, 1)])
def test_a_clipped_pixel_hides_blocks_within_four_pixels(side: int, hidden: int) -> None:
    marked = np.zeros((80, 80), bool)
    marked[11, 11] = True

    known = _open_blocks(marked, side)

    assert known.shape == (80 // side, 80 // side)
    assert (~known).sum() == hidden
    assert not known[11 // side, 11 // side]
