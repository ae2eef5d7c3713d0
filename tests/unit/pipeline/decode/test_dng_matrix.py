"""Which matrix of a DNG tells its camera's colours, and what the file multiplies it by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from pipeline.decode.dng_matrix import dng_matrix

COLOURS = np.array([[0.5, -0.1, 0.0], [-0.4, 1.2, 0.2], [0.0, 0.2, 0.6]])
DIFFERS = np.array([[1.1, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.1, 0.9]])
BALANCE = [2.0, 1.0, 1.5]
RAW = np.full((16, 16), 5000, np.uint16)
ONE, TWO = ((50721, 50723, 50778), (50722, 50724, 50779))
"""Tags of matrix, calibration and light."""


def fractions(values: ArrayLike) -> list[int]:
    parts: NDArray[Any] = np.rint(np.ravel(values) * 1000).astype(int)
    return [part for value in parts.tolist() for part in (value, 1000)]


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (17, 21, 2.0),
        (21, 17, 1.0),
        (17, 23, 2.0),
        (23, 17, 1.0),
        (20, 17, 1.0),
        (4, 3, 1.0),
        (23, 21, 2.0),
        (21, 23, 1.0),
        (255, 23, 2.0),
        (255, 255, 2.0),
        (21, None, 1.0),
    ],
)
def test_the_daylight_matrix_is_taken(
    dng_file: Callable[..., bytes], first: int, second: int | None, expected: float
) -> None:
    tags = [(50721, "2i", 9, fractions(np.eye(3))), (50778, "H", 1, first)]
    if second is not None:
        tags += [(50722, "2i", 9, fractions(2 * np.eye(3))), (50779, "H", 1, second)]

    found = dng_matrix(dng_file(RAW, more=tuple(tags)))

    np.testing.assert_array_equal(found, expected * np.eye(3))


def own_tags(*, light: int = 21, tags: tuple[int, int, int] = ONE) -> list[tuple[Any, ...]]:
    matrix, calibration, of = tags
    return [
        (matrix, "2i", 9, fractions(COLOURS)),
        (calibration, "2i", 9, fractions(DIFFERS)),
        (of, "H", 1, light),
    ]


def test_how_a_camera_differs_and_its_gains_count(dng_file: Callable[..., bytes]) -> None:
    more = (*own_tags(), (50727, "2I", 3, fractions(BALANCE)))

    found = dng_matrix(dng_file(RAW, more=more))

    assert found is not None
    np.testing.assert_allclose(found, np.diag(BALANCE) @ DIFFERS @ COLOURS, rtol=0, atol=1e-12)


def test_a_calibration_goes_with_the_matrix_of_its_light(dng_file: Callable[..., bytes]) -> None:
    other = [
        (50721, "2i", 9, fractions(np.eye(3))),
        (50723, "2i", 9, fractions(np.diag([3.0, 2.0, 1.0]))),
        (50778, "H", 1, 17),
    ]

    found = dng_matrix(dng_file(RAW, more=(*other, *own_tags(tags=TWO))))

    assert found is not None
    np.testing.assert_allclose(found, DIFFERS @ COLOURS, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("camera", "profile", "counts"),
    [("a", "a", True), ("a", "b", False), (None, "b", False), ("a", None, False)],
)
def test_a_calibration_for_another_profile_is_left(
    dng_file: Callable[..., bytes], camera: str | None, profile: str | None, counts: bool
) -> None:
    signed = [(50931, camera), (50932, profile)]
    signatures = [(tag, "s", 0, name) for tag, name in signed if name is not None]

    found = dng_matrix(dng_file(RAW, more=(*own_tags(), *signatures)))

    expected = DIFFERS @ COLOURS if counts else COLOURS
    assert found is not None
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("count", [1, 4])
def test_gains_of_another_number_of_colours_are_left(
    dng_file: Callable[..., bytes], count: int
) -> None:
    more = (*own_tags(), (50727, "2I", count, fractions([2.0] * count)))

    found = dng_matrix(dng_file(RAW, more=more))

    assert found is not None
    np.testing.assert_allclose(found, DIFFERS @ COLOURS, rtol=0, atol=1e-12)


@pytest.mark.parametrize("data", [b"", b"text", b"II*\x00\x08\x00\x00\x00"])
def test_other_bytes_have_no_matrix(data: bytes) -> None:
    assert dng_matrix(data) is None
