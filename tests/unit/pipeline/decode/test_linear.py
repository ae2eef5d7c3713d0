from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.colour.curves import srgb_to_linear
from pipeline.decode.linear import clipped, clipped_photosites, to_linear
from pipeline.decode.samples import Samples, upright
from pipeline.decode.saturation import RAW_CLIP


@pytest.mark.parametrize("rows", [1, 255, 256, 257, 600])
def test_pictures_of_any_height_are_converted_to_the_last_row(rows: int) -> None:
    values = np.random.default_rng(0).integers(0, 65535, (rows, 3, 3), dtype=np.uint16)

    linear = to_linear(Samples(values, 65535.0), srgb=False)

    np.testing.assert_allclose(linear, values / 65535.0, atol=1e-6)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_integers_follow_the_curve_however_the_picture_is_turned(
    kind: type, orientation: int
) -> None:
    white = np.iinfo(kind).max
    values: NDArray[Any] = np.random.default_rng(0).integers(0, white + 1, (300, 7, 3)).astype(kind)

    linear = to_linear(Samples(values, float(white), orientation), srgb=True)

    turned = (upright(values, orientation) / white).astype(np.float32)
    np.testing.assert_array_equal(linear, srgb_to_linear(turned))


@pytest.mark.parametrize(
    ("kind", "raw"), [(np.uint8, False), (np.uint16, False), (np.uint16, True)]
)
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_pixel_is_clipped_where_one_channel_reaches_the_limit(
    kind: type, raw: bool, orientation: int
) -> None:
    white = np.iinfo(kind).max
    near = int(0.99 * white) if raw else white - 4
    rng = np.random.default_rng(0)
    values: NDArray[Any] = rng.integers(near, white, (300, 7, 3), endpoint=True).astype(kind)
    values[:, :5] = near
    limit = RAW_CLIP * white if raw else white - (kind == np.uint8)

    mask = clipped(Samples(values, float(white), orientation), limit if raw else None)

    expected = np.asarray((upright(values, orientation) >= limit).any(axis=2))
    if raw:
        expected = np.asarray(cv2.dilate(expected.view(np.uint8), np.ones((5, 5), np.uint8)) > 0)
    assert mask.dtype == np.bool_
    np.testing.assert_array_equal(mask, expected)


def test_8_bit_samples_are_clipped_from_254() -> None:
    values = np.full((2, 3, 3), 100, np.uint8)
    values[0, 0, 1], values[0, 1, 2], values[1, 2, 0] = 253, 254, 255

    mask = clipped(Samples(values, 255.0))

    np.testing.assert_array_equal(mask, [[False, True, False], [False, False, True]])


def test_16_bit_samples_are_clipped_at_white_alone() -> None:
    values = np.array([[[65534] * 3, [65535, 0, 0]]], np.uint16)

    np.testing.assert_array_equal(clipped(Samples(values, 65535.0)), [[False, True]])


def test_floats_are_clipped_only_where_1_is_their_end() -> None:
    values = np.array([[[0.2, 1.0, 0.3], [0.9, 0.99, 0.1]]], np.float32)

    np.testing.assert_array_equal(clipped(Samples(values, 1.0)), [[True, False]])
    values[0, 1, 1] = 1.5
    assert not clipped(Samples(values, 1.0)).any()


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_a_channel_of_linear_values_may_end_below_white(dtype: type) -> None:
    white = 65535.0 if dtype is np.uint16 else 1.0
    values = np.random.default_rng(0).uniform(0.05, 0.3, (40, 50, 3))
    values[:5, :20, 0], values[20:30, :10, 2] = 0.8, 0.4  # 100 values each
    samples = Samples((white * values).astype(dtype), white)

    expected = np.zeros((40, 50), bool)
    expected[:5, :20] = expected[20:30, :10] = True
    np.testing.assert_array_equal(clipped(samples, linear=True), expected)
    assert not clipped(samples).any()


def test_linear_values_that_end_below_white_are_clipped_at_white_as_well() -> None:
    values = np.full((40, 50, 3), 10_000, np.uint16)
    values[:5, :20, 0], values[7, 7, 1] = 40_000, 65_535

    mask = clipped(Samples(values, 65535.0), linear=True)

    assert mask[:5, :20].all()
    assert mask[7, 7]
    assert mask.sum() == 101


def test_a_clipped_sensor_value_spoils_the_pixels_around_it() -> None:
    values = np.full((11, 11, 3), 20_000, np.uint16)
    values[5, 5, 0] = 65_000

    mask = clipped(Samples(values, 65535.0), RAW_CLIP * 65535)

    expected = np.zeros((11, 11), bool)
    expected[3:8, 3:8] = True
    np.testing.assert_array_equal(mask, expected)


def test_a_photosite_spoils_the_pixels_around_it_from_its_own_level_of_black_on() -> None:
    black = np.array([[600.0, 610.0], [620.0, 640.0]])
    mosaic = np.full((13, 12), 9_000, np.uint16)
    mosaic[4, 2], mosaic[4, 3], mosaic[9, 8], mosaic[9, 9] = 10_499, 10_510, 10_519, 10_539

    mask = clipped_photosites(mosaic, black, 10_000)

    expected = np.zeros((13, 12), bool)
    expected[2:7, 1:6] = True  # of (4, 3) alone: 610 + 9900
    np.testing.assert_array_equal(mask, expected)


@pytest.mark.parametrize("size", [(2, 2), (3, 5), (40, 31)])
def test_photosites_are_clipped_as_a_picture_of_them_is(size: tuple[int, int]) -> None:
    """With one level of black for all, and white at the end of 16 bits."""
    mosaic = np.random.default_rng(0).integers(64_000, 65_535, size, dtype=np.uint16)
    mosaic[:, : size[1] // 2] = 1

    mask = clipped_photosites(mosaic, np.zeros((2, 2)), 65535.0)

    grey = np.repeat(mosaic[..., None], 3, axis=2)
    np.testing.assert_array_equal(mask, clipped(Samples(grey, 65535.0), RAW_CLIP * 65535))


def test_the_mask_is_turned_with_the_picture() -> None:
    values = np.zeros((2, 3, 3), np.uint8)
    values[0, 0] = 255

    mask = clipped(Samples(values, 255.0, orientation=6))

    np.testing.assert_array_equal(mask, [[False, True], [False, False], [False, False]])


def test_eight_turns_of_a_letter() -> None:
    """The places of row 0, column 0 as EXIF 2.32 describes them under tag 0x0112."""
    letter = np.array([[1, 2, 3], [4, 5, 6]])
    turned = {
        1: [[1, 2, 3], [4, 5, 6]],
        2: [[3, 2, 1], [6, 5, 4]],
        3: [[6, 5, 4], [3, 2, 1]],
        4: [[4, 5, 6], [1, 2, 3]],
        5: [[1, 4], [2, 5], [3, 6]],
        6: [[4, 1], [5, 2], [6, 3]],
        7: [[6, 3], [5, 2], [4, 1]],
        8: [[3, 6], [2, 5], [1, 4]],
    }
    for orientation, expected in turned.items():
        np.testing.assert_array_equal(upright(letter, orientation), expected)
