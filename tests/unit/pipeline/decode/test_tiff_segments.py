"""A tile of a TIFF tells by its own header how large it is, and is not decoded where that is much.

The decoder would take memory for what the header tells, and a small TIFF be refused after that.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from pipeline.decode.tiff import read_tiff
from pipeline.decode.tiff_segments import segment_pixels

Codes = NDArray[np.uint8]
Encode = Callable[..., bytes]

KINDS: dict[str, tuple[str, Encode]] = {
    "JPEG 2000": ("jpeg2000", lambda codes: bytes(imagecodecs.jpeg2k_encode(codes, level=0))),
    "JPEG 2000 in boxes": (
        "jpeg2000",
        lambda codes: bytes(imagecodecs.jpeg2k_encode(codes, level=0, codecformat="jp2")),
    ),
    "JPEG XL": ("jpegxl", lambda codes: bytes(imagecodecs.jpegxl_encode(codes, lossless=True))),
    "JPEG XL in boxes": (
        "jpegxl",
        lambda codes: bytes(imagecodecs.jpegxl_encode(codes, lossless=True, usecontainer=True)),
    ),
    "WebP": ("webp", lambda codes: bytes(imagecodecs.webp_encode(codes, level=90))),
    "WebP without loss": ("webp", lambda codes: bytes(imagecodecs.webp_encode(codes))),
    "PNG": ("png", lambda codes: bytes(imagecodecs.png_encode(codes))),
}


def tiff_of_tile(codes: Codes, kind: str, shape: tuple[int, int]) -> bytes:
    """A TIFF of one tile that holds codes, whatever its shape is told to be."""
    compression, encode = KINDS[kind]
    options: dict[str, Any] = {"tile": shape, "compression": compression, "photometric": "rgb"}
    file = io.BytesIO()
    tifffile.imwrite(
        file, iter([encode(codes)]), shape=(*shape, 3), dtype=np.uint8, metadata=None, **options
    )
    return file.getvalue()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shape", [(48, 64), (64, 64), (100, 150), (17, 301), (8, 9), (90, 60)])
def test_pixels_are_those_that_the_decoder_gives(kind: str, shape: tuple[int, int]) -> None:
    codes = np.full((*shape, 3), 100, np.uint8)
    assert segment_pixels(KINDS[kind][1](codes)) == shape[0] * shape[1]


def test_a_canvas_of_webp_and_an_offset_of_jpeg_2000_are_read_by_the_standard() -> None:
    canvas = b"\x07\0\0\xff\x02\0"  # 8 × 768
    assert segment_pixels(b"RIFF\0\0\0\0WEBPVP8X" + bytes(8) + canvas) == 8 * 768

    siz = b"\xff\x4f\xff\x51" + struct.pack(">HH4I", 41, 0, 110, 60, 10, 20)
    assert segment_pixels(siz) == 100 * 40
    assert segment_pixels(b"\xff\x4f\xff\x51" + struct.pack(">HH4I", 41, 0, 10, 20, 110, 60)) == 0


@pytest.mark.parametrize("kind", KINDS)
def test_of_a_header_that_is_cut_off_nothing_is_told(kind: str) -> None:
    data = KINDS[kind][1](np.full((48, 64, 3), 100, np.uint8))
    told = {segment_pixels(data[:count]) for count in range(min(len(data), 300))}
    assert told <= {0, 48 * 64}


@pytest.mark.parametrize("data", [b"", b"text", bytes(100), b"RIFF\0\0\0\0WAVEfmt "])
def test_of_other_bytes_nothing_is_told(data: bytes) -> None:
    assert segment_pixels(data) == 0


@pytest.mark.parametrize("kind", KINDS)
def test_a_tile_as_large_as_the_tiff_tells_is_read(codes: Codes, kind: str) -> None:
    read = read_tiff(tiff_of_tile(codes, kind, (48, 64)), 1).values
    np.testing.assert_allclose(read.astype(int), codes.astype(int), atol=8)


@pytest.mark.parametrize("kind", KINDS)
def test_a_tile_larger_than_the_tiff_tells_is_not_decoded(codes: Codes, kind: str) -> None:
    with pytest.raises(ValueError, match="a tile or strip that is larger than it may be"):
        read_tiff(tiff_of_tile(codes, kind, (16, 16)), 1)
