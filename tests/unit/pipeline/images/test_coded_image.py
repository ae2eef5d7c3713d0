from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.images.coded_image import LevelImage, TableImage
from pipeline.images.memory import releasable

TABLE = np.square(np.linspace(0, 1, 256, dtype=np.float32))


@pytest.fixture
def codes() -> NDArray[np.uint8]:
    return np.random.default_rng(4).integers(0, 256, (300, 50, 3), np.uint8)


@pytest.mark.parametrize(
    "key",
    [
        slice(None),
        slice(7, 40),
        (slice(None, None, 4), slice(None, None, 3)),
        (slice(8, 16), slice(5, 9)),
        (slice(3, 5), slice(None), 1),
        (4, 5),
        (np.array([1, 2]), np.array([3, 4])),
    ],
)
def test_what_is_looked_at_is_linear(codes: NDArray[np.uint8], key: Any) -> None:
    coded = TableImage(codes, TABLE)

    assert coded[key].dtype == np.float32
    np.testing.assert_array_equal(coded[key], TABLE[codes][key])
    np.testing.assert_array_equal(np.asarray(coded), TABLE[codes])
    assert coded.shape == codes.shape and len(coded) == 300 and coded.ndim == 3


def test_rows_lie_by_planes(codes: NDArray[np.uint8]) -> None:
    planes = np.empty((3, 32, 50), np.float32)

    TableImage(codes, TABLE).write_planes(slice(30, 62), planes)

    np.testing.assert_array_equal(np.moveaxis(planes, 0, -1), TABLE[codes[30:62]])


def test_division_is_that_of_the_values(codes: NDArray[np.uint8]) -> None:
    coded = TableImage(codes, TABLE)

    np.testing.assert_array_equal(coded.divided(0.3)[:], coded[:] / np.float32(0.3))


def test_rows_that_are_given_back_are_those_of_code_0(codes: NDArray[np.uint8]) -> None:
    coded = TableImage(releasable(codes), TABLE + 1)

    coded.release_rows(200)

    assert (coded[:150] == 1).all()
    np.testing.assert_array_equal(coded[200:], 1 + TABLE[codes[200:]])


@pytest.fixture
def deep() -> NDArray[np.uint16]:
    return np.random.default_rng(5).integers(0, 65536, (300, 50, 3), np.uint16)


@pytest.mark.parametrize(
    "key", [slice(None), (slice(None, None, 4), slice(5, 9)), (slice(3, 5), slice(None), 1), (4, 5)]
)
def test_16_bits_grow_evenly_from_black(deep: NDArray[np.uint16], key: Any) -> None:
    coded = LevelImage(deep, 2048.0, 1 / 60000)

    light = (deep.astype(np.float64) - 2048) / 60000

    assert coded[key].dtype == np.float32 and coded.shape == deep.shape
    np.testing.assert_allclose(coded[key], light[key], rtol=2e-7)
    np.testing.assert_allclose(coded.divided(0.3)[key], light[key] / 0.3, rtol=3e-7)


@pytest.mark.parametrize("quarters", [0, 1, 2])
def test_16_bits_lie_by_planes(deep: NDArray[np.uint16], quarters: int) -> None:
    coded = LevelImage(np.rot90(deep, quarters), 2048.0, 1 / 60000)
    planes = np.empty((3, 20, coded.shape[1]), np.float32)

    coded.write_planes(slice(30, 50), planes)

    np.testing.assert_array_equal(np.moveaxis(planes, 0, -1), coded[30:50])
