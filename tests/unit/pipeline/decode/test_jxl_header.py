"""The header of a JPEG XL tells what its samples are."""

from __future__ import annotations

import struct
from typing import Any

import imagecodecs
import numpy as np
import pytest

from pipeline.decode.jxl_header import jxl_samples


def encoded(shape: tuple[int, ...], dtype: type, **options: Any) -> bytes:
    return bytes(imagecodecs.jpegxl_encode(np.ones(shape, dtype), **options))


@pytest.mark.parametrize("shape", [(8, 8), (64, 96, 3), (63, 97), (512, 512), (1000, 3), (8, 9000)])
@pytest.mark.parametrize("container", [False, True])
@pytest.mark.parametrize("how", [{"lossless": True}, {"distance": 1.0}])
def test_bits_of_integers(shape: tuple[int, ...], container: bool, how: dict[str, Any]) -> None:
    for bits in (1, 7, 8, 9, 10, 12, 14, 16):
        kind = np.uint8 if bits <= 8 else np.uint16
        data = encoded(shape, kind, bitspersample=bits, usecontainer=container, **how)

        assert jxl_samples(data) == (bits, False)


@pytest.mark.parametrize(("kind", "bits"), [(np.float16, 16), (np.float32, 32)])
@pytest.mark.parametrize("how", [{"lossless": True}, {"distance": 1.0}])
def test_bits_of_floats(kind: type, bits: int, how: dict[str, Any]) -> None:
    assert jxl_samples(encoded((64, 96, 3), kind, **how)) == (bits, True)


def test_24_bits_and_a_size_beside_the_pictures_are_read_by_the_standard() -> None:
    """No encoder at hand writes them: 8 × 8, not usual, orientation 1, of another size, floats."""
    fields = [(1, 1), (0, 5), (1, 3), (0, 1), (1, 1), (0, 3), (1, 1), (1, 1), (0, 5), (1, 3)]
    fields += [(0, 2), (1, 1), (2, 2)]
    value, at = 0, 0
    for field, width in fields:
        value |= field << at
        at += width

    assert jxl_samples(b"\xff\x0a" + value.to_bytes(8, "little")) == (24, True)


def test_boxes_of_all_kinds_are_read() -> None:
    stream = encoded((64, 96), np.uint16, bitspersample=12, usecontainer=False)
    head = bytes.fromhex("0000000c4a584c200d0a870a0000001466747970") + b"jxl \0\0\0\0jxl "
    part = struct.pack(">I4sI", 12 + len(stream), b"jxlp", 1 << 31) + stream
    large = struct.pack(">I4sQ", 1, b"jxlc", 16 + len(stream)) + stream
    last = struct.pack(">I4s", 0, b"jxlc") + stream

    for box in (part, large, last):
        assert jxl_samples(head + box) == (12, False)
        assert imagecodecs.jpegxl_decode(head + box).shape == (64, 96)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff\x0a",
        b"\xff\xd8\xff\xe0" + bytes(100),
        bytes(100),
        bytes.fromhex("0000000c4a584c200d0a870a"),
        bytes.fromhex("0000000c4a584c200d0a870a") + bytes(100),
        bytes.fromhex("0000000c4a584c200d0a870a") + struct.pack(">I4s", 8, b"jxlc"),
        bytes.fromhex("0000000c4a584c200d0a870a") + struct.pack(">I4s", 2**31, b"ftyp"),
    ],
    ids=["nothing", "cut", "JPEG", "zeros", "no box", "empty box", "no stream", "beyond the end"],
)
def test_anything_else_is_no_jpeg_xl(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"JPEG XL"):
        jxl_samples(data)


def test_a_moving_picture_is_refused() -> None:
    with pytest.raises(ValueError, match="more than one picture"):
        jxl_samples(encoded((3, 32, 32, 3), np.uint8, lossless=True))
