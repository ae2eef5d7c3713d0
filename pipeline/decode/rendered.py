"""JPEG, PNG and HEIF: pictures made for looking at."""

from __future__ import annotations

import struct
from typing import Any

import imagecodecs
import numpy as np
import pillow_heif
import simplejpeg

from pipeline.decode.samples import Samples, to_rgb

_PNG_END = b"IEND\xaeB`\x82"


def jpeg_size(data: bytes) -> tuple[int, int]:
    """(width, height) from the header, before orientation. Raises ValueError."""
    height, width, _colours, _sampling = simplejpeg.decode_jpeg_header(data)
    return width, height


def read_jpeg(data: bytes, orientation: int) -> Samples:
    """Read a whole JPEG; a truncated or damaged one raises ValueError."""
    if simplejpeg.decode_jpeg_header(data)[2] == "CMYK":
        raise ValueError("CMYK is no camera's encoding")
    return Samples(simplejpeg.decode_jpeg(data, "RGB", strict=True), 255.0, orientation)


def png_size(data: bytes) -> tuple[int, int]:
    """(width, height) from the header, before orientation. Raises ValueError or struct.error."""
    if data[12:16] != b"IHDR":
        raise ValueError("no IHDR chunk")
    width, height = struct.unpack(">II", data[16:24])
    if not width or not height:
        raise ValueError("no pixels")
    return width, height


def read_png(data: bytes, orientation: int) -> Samples:
    """Read an 8- or 16-bit PNG: grey, palette, RGB, with or without alpha."""
    if _PNG_END not in data[-4096:]:
        raise ValueError("no end chunk")
    values = to_rgb(imagecodecs.png_decode(data))
    return Samples(values, float(np.iinfo(values.dtype).max), orientation)


def heif_size(data: bytes) -> tuple[int, int]:
    """(width, height) as shown. Raises ValueError and what libheif raises."""
    width, height = _open_heif(data).size
    return width, height


def read_heif(data: bytes) -> Samples:
    """Read the primary picture of a HEIF file, which libheif has turned upright.

    EXIF orientation says nothing here: ISO/IEC 23008-12 turns pictures by `irot` and `imir`.
    """
    image = _open_heif(data)
    values = to_rgb(np.asarray(image))
    bits = image.info["bit_depth"]  # 10 and 12 bits come shifted up to 16
    white = 255 if values.dtype == np.uint8 else (2**bits - 1) << (16 - bits)
    return Samples(values, float(white))


def _open_heif(data: bytes) -> Any:
    return pillow_heif.open_heif(data, convert_hdr_to_8bit=False)
