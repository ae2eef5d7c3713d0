from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats32
from pipeline.encode.half_floats import write_half


def halved(light: Floats32) -> NDArray[np.float16]:
    half = np.full(light.shape, np.nan, np.float16)
    write_half(light, half)
    return half


def test_every_half_float_comes_back() -> None:
    every = np.arange(2**16, dtype=np.uint16).view(np.float16).reshape(256, 256)
    every = np.where(np.isfinite(every), every, np.float16(0))

    np.testing.assert_array_equal(halved(every.astype(np.float32)), every)


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
    found = halved(np.full((2, 3), light, np.float32))
    assert (found == half).all()


def test_a_channel_of_a_picture_is_taken_as_it_lies() -> None:
    picture = np.random.default_rng(1).random((5, 7, 3), dtype=np.float32)
    half = halved(picture[..., 1])
    np.testing.assert_array_equal(half, picture[..., 1].astype(np.float16))


def test_it_is_written_among_other_bytes() -> None:
    light = np.random.default_rng(2).random((4, 6), dtype=np.float32)
    lines = np.zeros((4, 22), np.uint8)

    write_half(light, lines[:, 8:20].view(np.float16))

    np.testing.assert_array_equal(lines[:, 8:20].copy().view(np.float16), light.astype(np.float16))
    assert not lines[:, [0, 7, 20, 21]].any()
