from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.images.area_means import area_means
from pipeline.pair.align import estimate_alignment
from pipeline.pair.full_size import full_size_shift
from pipeline.pair.refine import log_detail

SIZE = (768, 512)
FINE = 3  # times as fine is what pictures are averaged from


@cache
def paint(size: tuple[int, int]) -> Floats32:
    """Reflectance with texture of about a pixel, (H, W) FINE times as large as size."""
    width, height = (FINE * side for side in size)
    drawn = np.random.default_rng(3).standard_normal((height, width), np.float32)
    grain = np.asarray(cv2.GaussianBlur(drawn, (0, 0), 1.2 * FINE), np.float32)
    return np.asarray(np.exp(0.6 * grain / grain.std()) * 0.2, np.float32)


def seen(scene: Floats32, shift: tuple[int, int], light: Floats64, seed: int) -> Floats32:
    """A photograph under a light, with noise, moved by so many parts of a pixel, FINE of one."""
    moved = np.roll(scene, shift, axis=(1, 0))
    width, height = scene.shape[1] // FINE, scene.shape[0] // FINE
    pixels = area_means(moved, (width, height))[..., None] * light.astype(np.float32)
    noise = np.random.default_rng(seed).normal(0, 0.002, pixels.shape)
    return np.asarray(pixels + noise, np.float32)


def lights(size: tuple[int, int]) -> tuple[Floats64, Floats64]:
    """A lamp from one side, and the same with a flash."""
    across = np.linspace(0.3, 1.0, size[0])[None, :, None]
    lamp = across * [0.9, 0.6, 0.3]
    return lamp, lamp + 0.5


def pair(shift: tuple[int, int], size: tuple[int, int] = SIZE) -> tuple[Floats32, Floats32]:
    scene, (lamp, both) = paint(size), lights(size)
    return seen(scene, (0, 0), lamp, 1), seen(scene, shift, both, 2)


def found(no_flash: Floats32, flash: Floats32) -> Floats64:
    height, width, _ = no_flash.shape
    small = (log_detail(area_means(one, (width // 4, height // 4))) for one in (no_flash, flash))
    first, second = small
    return full_size_shift(no_flash, flash, (first, second))


@pytest.mark.parametrize("shift", [(1, 0), (0, -2), (2, 1), (-3, 2)])
def test_texture_tells_a_part_of_a_pixel(shift: tuple[int, int]) -> None:
    np.testing.assert_allclose(found(*pair(shift)), np.array(shift) / FINE, atol=0.03)


def test_what_lies_still_stays() -> None:
    np.testing.assert_array_equal(found(*pair((0, 0))), np.zeros(2))


def test_a_tenth_of_a_pixel_is_not_worth_resampling() -> None:
    no_flash, flash = pair((0, 0))
    moved = cv2.warpAffine(
        flash, np.array([[1, 0, 0.1], [0, 1, 0]]), SIZE, flags=cv2.INTER_LANCZOS4
    )

    np.testing.assert_array_equal(found(no_flash, np.asarray(moved, np.float32)), np.zeros(2))


def test_a_part_of_the_picture_that_moved_does_not_move_the_rest() -> None:
    no_flash, flash = pair((0, 0))
    _, moved = pair((2, 1))
    flash[: SIZE[1] // 3] = moved[: SIZE[1] // 3]

    np.testing.assert_array_equal(found(no_flash, flash), np.zeros(2))


def test_things_that_each_went_their_own_way_agree_on_nothing() -> None:
    no_flash, flash = pair((0, 0))
    for column, shift in enumerate([(2, 1), (-2, 1), (1, -2), (-1, -2), (0, 2), (0, 0)]):
        columns = slice(column * 128, (column + 1) * 128)
        flash[:, columns] = pair(shift)[1][:, columns]

    np.testing.assert_array_equal(found(no_flash, flash), np.zeros(2))


@pytest.mark.parametrize("same", [True, False], ids=["grey", "noise"])
def test_where_nothing_is_seen_nothing_is_told(same: bool) -> None:
    rng = np.random.default_rng(5)
    deviation = 0.0 if same else 0.05
    first, second = (
        (0.3 + rng.normal(0, deviation, (512, 768, 3))).astype(np.float32) for _ in range(2)
    )

    np.testing.assert_array_equal(found(first, second), np.zeros(2))


def test_pictures_smaller_than_tiles_tell_nothing() -> None:
    no_flash, flash = pair((2, 1), (120, 96))

    np.testing.assert_array_equal(found(no_flash, flash), np.zeros(2))


def test_large_photographs_are_laid_on_each_other_by_a_third_of_a_pixel() -> None:
    no_flash, flash = pair((1, -1), (2000, 600))

    alignment = estimate_alignment(no_flash, flash)

    assert alignment.applied
    np.testing.assert_allclose(alignment.matrix[:2, 2], [1 / 3, -1 / 3], atol=0.03)
    np.testing.assert_array_equal(alignment.matrix[:, :2], np.eye(3)[:, :2])
