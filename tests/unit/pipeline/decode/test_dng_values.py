"""DNGs of which LibRaw would make other values than are meant, and say nothing."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.decode import decode
from tests.refusal import refusal

Write = Callable[..., bytes]
LINEARIZATION, LIST_1, LIST_2, LIST_3 = 50712, 51008, 51009, 51022
MAP_TABLE, MAP_POLYNOMIAL, GAIN_MAP, DELTA_PER_ROW, DELTA_PER_COLUMN = 7, 8, 9, 10, 11
WHITE_1 = (50717, "I", 3, (1, 1, 1))
SQUARE = (0.0, 0.0, 1.0)


def opcode(number: int, plane: int = 0, planes: int = 1, more: bytes = b"") -> bytes:
    area = struct.pack(">8I", 0, 0, 64, 96, plane, planes, 1, 1)
    return struct.pack(">4I", number, 0x01030000, 0, len(area + more)) + area + more


def polynomial(plane: int = 0, planes: int = 1) -> bytes:
    degree = len(SQUARE) - 1
    return opcode(MAP_POLYNOMIAL, plane, planes, struct.pack(">I3d", degree, *SQUARE))


def listed(*opcodes: bytes, tag: int = LIST_2) -> tuple[Any, ...]:
    block = struct.pack(">I", len(opcodes)) + b"".join(opcodes)
    return (tag, 7, len(block), block)


def ramp() -> Floats64:
    x = np.linspace(0.02, 0.9, 96)[None, :, None]
    y = np.linspace(1.0, 0.6, 64)[:, None, None]
    return np.asarray(x * y * np.array([0.55, 1.0, 0.8]))


@pytest.fixture
def lossy(dng: Write) -> Write:
    """Write a ramp as a lossy DNG, whose values are the square roots of light."""

    def write(*tags: tuple[Any, ...]) -> bytes:
        roots = np.rint(np.sqrt(ramp()) * 255).astype(np.uint8)
        level = {"level": 98}
        return dng(roots, *tags, compression="jpeg_lossy", compressionargs=level, tile=(64, 96))

    return write


@pytest.mark.parametrize("tag", [LIST_1, LIST_2, LIST_3])
@pytest.mark.parametrize("number", [MAP_TABLE, MAP_POLYNOMIAL, DELTA_PER_ROW, DELTA_PER_COLUMN])
def test_opcodes_that_bend_values_are_refused(dng_file: Write, number: int, tag: int) -> None:
    mosaic = np.full((64, 96), 3000, np.uint16)
    block = listed(opcode(GAIN_MAP), opcode(number), tag=tag)

    assert "values are bent in a way that is not read: save it" in refusal(
        dng_file(mosaic, more=(block,))
    )


@pytest.mark.parametrize("block", [b"", b"\0\0\0\3", struct.pack(">I", 2) + opcode(GAIN_MAP)])
def test_opcodes_that_scale_or_are_cut_off_change_nothing(dng_file: Write, block: bytes) -> None:
    mosaic = np.linspace(700, 9000, 64 * 96).reshape(64, 96).astype(np.uint16)
    plain = decode(dng_file(mosaic))

    frame = decode(dng_file(mosaic, more=((LIST_2, 7, len(block), block),) if block else ()))

    np.testing.assert_array_equal(frame.pixels, plain.pixels)


def test_a_lossy_dng_follows_its_polynomials(lossy: Write) -> None:
    frame = decode(lossy(listed(*map(polynomial, range(3)))))

    np.testing.assert_allclose(frame.pixels, ramp(), atol=0.02)


@pytest.mark.parametrize(
    "tags",
    [
        (),
        (listed(polynomial(planes=3)),),
        (listed(polynomial(0), polynomial(1)),),
        (listed(opcode(MAP_TABLE, planes=3)),),
        (listed(*map(polynomial, range(3)), opcode(MAP_TABLE)),),
        (listed(*map(polynomial, range(3))), (LINEARIZATION, "H", 256, tuple(range(256)))),
    ],
    ids=["none", "one for all", "two of three", "a table", "a table after them", "linearization"],
)
def test_a_lossy_dng_of_other_curves_is_refused(lossy: Write, tags: Any) -> None:
    assert "values are bent in a way that is not read: save it" in refusal(lossy(*tags))


@pytest.mark.parametrize("kind", [np.float16, np.float32])
def test_deflated_floats_are_read_with_their_predictor(dng: Write, kind: type) -> None:
    data = dng(ramp().astype(kind), WHITE_1, compression="zlib", predictor=3)

    np.testing.assert_allclose(decode(data).pixels, ramp(), atol=1e-3)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.uint16])
def test_other_deflated_values_are_refused(dng: Write, kind: type) -> None:
    """LibRaw undoes a predictor that floats do not have, and calls integers damaged."""
    white = 1 if np.issubdtype(kind, np.floating) else 65535
    values: NDArray[Any] = (ramp() * white).astype(kind)

    sentence = refusal(dng(values, WHITE_1, compression="zlib"))

    assert "is a DNG of a compression that is not read: save it as an uncompressed" in sentence


def test_half_floats_without_a_white_level_are_refused(dng: Write) -> None:
    """LibRaw takes 65535 for their white, and all is black."""
    assert "does not tell their white level" in refusal(dng(ramp().astype(np.float16)))
