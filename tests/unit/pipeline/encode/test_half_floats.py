from __future__ import annotations

import numpy as np
import pytest

from pipeline.encode.half_floats import to_half


def test_every_half_float_comes_back() -> None:
    every = np.arange(2**16, dtype=np.uint16).view(np.float16).reshape(256, 256)
    every = np.where(np.isfinite(every), every, np.float16(0))

    np.testing.assert_array_equal(to_half(every.astype(np.float32)), every)


@pytest.mark.parametrize(
    ("light", "half"),
    [
        (0.2, 0.199951171875),
        (1 + 2**-11, 1.0),  # between two of them the even one
        (1 + 3 * 2**-11, 1 + 2**-9),
        (2**-24, 2**-24),  # the smallest
        (2**-26, 0.0),
        (65519.0, 65504.0),
        (1e9, 65504.0),
        (-1e9, -65504.0),
    ],
)
def test_light_is_rounded_to_the_nearest_and_cut_off(light: float, half: float) -> None:
    found = to_half(np.full((2, 3), light, np.float32))
    assert found.dtype == np.float16
    assert (found == half).all()


def test_a_channel_of_a_picture_is_taken_as_it_lies() -> None:
    picture = np.random.default_rng(1).random((5, 7, 3), dtype=np.float32)
    half = to_half(picture[..., 1])
    np.testing.assert_array_equal(half, picture[..., 1].astype(np.float16))


def test_a_picture_by_planes_is_taken_whole() -> None:
    planes = np.random.default_rng(2).random((3, 5, 7), dtype=np.float32)
    picture = np.moveaxis(planes, 0, -1)
    half = to_half(picture)
    np.testing.assert_array_equal(half, picture.astype(np.float16))
