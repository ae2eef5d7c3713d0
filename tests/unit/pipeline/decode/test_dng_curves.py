"""Lossy DNGs in JPEG XL hold stretched values, and polynomials that take them back to light."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.decode import decode
from tests.jpeg_xl import in_jpeg_xl
from tests.refusal import refusal

Write = Callable[..., bytes]
LIST_1, LIST_2, LIST_3 = 51008, 51009, 51022
BLACK, WHITE, TABLE = 50714, 50717, 50712
MAP_TABLE, MAP_POLYNOMIAL, GAIN_MAP = 7, 8, 9
LINES = ((0.0, 0.4), (0.0, 0.9), (0.1, 0.5))
"""What colours are stretched by."""
AREA = (0, 0, 64, 96)


def opcode(number: int, body: bytes) -> bytes:
    return struct.pack(">4I", number, 0x01030000, 0, len(body)) + body


def polynomial(plane: int, *factors: float, area: Any = AREA, step: int = 1) -> bytes:
    where = struct.pack(">8I", *area, plane, 1, step, step)
    degree = struct.pack(">I", len(factors) - 1)
    return opcode(MAP_POLYNOMIAL, where + degree + struct.pack(f">{len(factors)}d", *factors))


def lines() -> list[bytes]:
    return [polynomial(plane, *line) for plane, line in enumerate(LINES)]


def listed(*opcodes: bytes, tag: int = LIST_2) -> tuple[Any, ...]:
    block = struct.pack(">I", len(opcodes)) + b"".join(opcodes)
    return (tag, 7, len(block), block)


def light() -> Floats64:
    """Each colour within what its line reaches."""
    x = np.linspace(0.02, 0.98, 96)[None, :, None] * np.linspace(1, 0.6, 64)[:, None, None]
    return np.stack([line[0] + line[1] * x[..., 0] for line in LINES], axis=-1)


def stretched(light: Floats64) -> Floats64:
    return np.stack([(light[..., c] - a) / b for c, (a, b) in enumerate(LINES)], axis=-1)


@pytest.fixture
def linear(dng: Write) -> Write:
    """Write values (H, W, 3) in tiles as an uncompressed linear DNG."""
    return partial(dng, tile=(32, 32))


def codes(shares: Floats64, black: Any = 0, white: int = 65535) -> NDArray[np.uint16]:
    return np.asarray(np.rint(black + shares * (white - black)), dtype=np.uint16)


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1]])
def test_a_line_for_each_colour_takes_its_values_back(linear: Write, order: list[int]) -> None:
    found = [lines()[plane] for plane in order]
    data = in_jpeg_xl(linear(codes(stretched(light())), listed(opcode(GAIN_MAP, b""), *found)))

    np.testing.assert_allclose(decode(data).pixels, light(), atol=3e-5)


@pytest.mark.parametrize(
    "levels",
    [
        ((BLACK, "H", 3, (1000,) * 3), (WHITE, "H", 3, (60000,) * 3)),
        ((BLACK, "2I", 3, (2000, 2) * 3), (WHITE, "H", 1, 60000)),
        ((BLACK, "H", 1, 1000), (WHITE, "H", 1, 60000)),
    ],
    ids=["of each colour", "fractions", "one"],
)
def test_values_are_between_black_and_white(linear: Write, levels: tuple[Any, ...]) -> None:
    values = codes(stretched(light()), 1000, 60000)

    frame = decode(in_jpeg_xl(linear(values, listed(*lines()), *levels)))

    np.testing.assert_allclose(frame.pixels, light(), atol=5e-5)


def test_values_above_white_are_as_white(linear: Write) -> None:
    values = np.full((64, 96, 3), 60000, np.uint16)

    frame = decode(in_jpeg_xl(linear(values, listed(*lines()), (WHITE, "H", 1, 50000))))

    expected = np.broadcast_to([0.4, 0.9, 0.6], values.shape)
    np.testing.assert_allclose(frame.pixels, expected, atol=5e-5)


def test_each_colour_has_its_own_levels(linear: Write) -> None:
    """As they are written uncompressed; LibRaw itself puts different ones on one scale."""
    black = np.array([900, 1000, 1100])
    levels = ((BLACK, "H", 3, tuple(map(int, black))), (WHITE, "H", 3, (60000,) * 3))

    values = codes(stretched(light()), black, 60000)
    frame = decode(in_jpeg_xl(linear(values, *levels, listed(*lines()))))

    expected = decode(linear(codes(light(), black, 60000), *levels))
    np.testing.assert_allclose(frame.pixels, expected.pixels[:], atol=5e-5)


def test_curves_of_a_higher_degree_are_followed(linear: Write) -> None:
    x = np.linspace(0, 1, 64 * 96 * 3).reshape(64, 96, 3)
    factors = (0.0, 0.25, 0.25, 0.5)
    cubic = [polynomial(plane, *factors) for plane in range(3)]

    frame = decode(in_jpeg_xl(linear(codes(x), listed(*cubic))))

    np.testing.assert_allclose(frame.pixels, 0.25 * x + 0.25 * x**2 + 0.5 * x**3, atol=5e-5)


@pytest.mark.parametrize(
    "tags",
    [
        (listed(*lines(), opcode(MAP_TABLE, bytes(32))),),
        (listed(opcode(MAP_TABLE, b"")),),
        (listed(*lines()[:2]),),
        (listed(*lines(), *lines()[:1]),),
        (listed(*lines(), tag=LIST_1),),
        (listed(*lines(), tag=LIST_3),),
        (listed(*lines(), tag=LIST_3), listed()),
        (listed(*lines()), (TABLE, "H", 1024, tuple(range(1024)))),
        (listed(*lines()[:2], polynomial(2, 0.1, 0.5, area=(0, 0, 32, 96))),),
        (listed(*lines()[:2], polynomial(2, 0.1, 0.5, step=2)),),
    ],
    ids=[
        "a table after them",
        "a table cut off",
        "two of three",
        "four",
        "before black is taken off",
        "after the colours are made",
        "beside an empty list",
        "linearization",
        "of a part",
        "of each second pixel",
    ],
)
def test_other_bends_are_refused(linear: Write, tags: tuple[Any, ...]) -> None:
    data = in_jpeg_xl(linear(codes(light()), *tags))

    assert "values are bent in a way that is not read: save it" in refusal(data)


def test_bent_floats_are_refused(linear: Write) -> None:
    white = (WHITE, "H", 1, 1)
    data = in_jpeg_xl(linear(light().astype(np.float16), white, listed(*lines())))

    assert "values are bent in a way that is not read: save it" in refusal(data)


@pytest.mark.parametrize(
    "tags",
    [
        (listed(*lines()[:2], polynomial(2, np.nan, 0.5)),),
        (listed(*lines()[:2], polynomial(2, 0.1, np.inf)),),
        (listed(*lines()[:2], polynomial(2, 0.1, 0.5)[:-4]),),
        (listed(*lines()), (BLACK, "H", 1, 65535)),
        (listed(*lines()), (BLACK, "2I", 1, (1, 0))),
        (listed(*lines()), (BLACK, "H", 2, (1, 1))),
        (listed(*lines()), (BLACK, "s", 0, "dark")),
    ],
    ids=["no number", "infinite", "cut off", "black at white", "no level", "two levels", "text"],
)
def test_polynomials_and_levels_that_cannot_be_are_damaged(
    linear: Write, tags: tuple[Any, ...]
) -> None:
    assert "damaged" in refusal(in_jpeg_xl(linear(codes(light()), *tags)))


def test_uncompressed_ones_are_refused_as_before(linear: Write) -> None:
    """LibRaw does not follow them, and nothing is written anew."""
    assert "values are bent in a way" in refusal(linear(codes(light()), listed(*lines())))
