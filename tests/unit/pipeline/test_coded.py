from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.coded import CodedImage
from pipeline.memory import releasable

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
    coded = CodedImage(codes, TABLE)

    assert coded[key].dtype == np.float32
    np.testing.assert_array_equal(coded[key], TABLE[codes][key])
    np.testing.assert_array_equal(np.asarray(coded), TABLE[codes])
    assert coded.shape == codes.shape and len(coded) == 300 and coded.ndim == 3


def test_rows_lie_by_planes(codes: NDArray[np.uint8]) -> None:
    rows = CodedImage(codes, TABLE).rows_by_planes(slice(30, 62))

    np.testing.assert_array_equal(rows, TABLE[codes[30:62]])
    assert all(rows[..., channel].flags.c_contiguous for channel in range(3))


def test_division_is_that_of_the_values(codes: NDArray[np.uint8]) -> None:
    coded = CodedImage(codes, TABLE)

    np.testing.assert_array_equal(coded.divided(0.3)[:], coded[:] / np.float32(0.3))


def test_rows_that_are_given_back_are_those_of_code_0(codes: NDArray[np.uint8]) -> None:
    coded = CodedImage(releasable(codes), TABLE + 1)

    coded.release_rows(200)

    assert (coded[:150] == 1).all()
    np.testing.assert_array_equal(coded[200:], 1 + TABLE[codes[200:]])
