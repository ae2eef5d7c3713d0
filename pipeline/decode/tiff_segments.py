"""Pixels of a tile or strip of a TIFF by its own header, which its decoder believes, not the TIFF.

Sources: ITU-T T.800 (SIZ, A.5.1; JP2 boxes, I.2); RFC 9649 (WebP); PNG specification (IHDR);
and those of pipeline.decode.jpeg_header and pipeline.decode.jxl_header.
"""

from __future__ import annotations

import contextlib
import struct

from pipeline.decode.boxes import box
from pipeline.decode.jpeg_header import frame_pixels
from pipeline.decode.jxl_header import jxl_pixels

_JP2 = b"\0\0\0\x0cjP  \r\n\x87\n"
_SIZ = b"\xff\x4f\xff\x51"
_JPEG, _PNG = b"\xff\xd8", b"\x89PNG\r\n\x1a\n"
_WEBP_SIDE = 0x3FFF
"""The 14 bits that hold a side; two more tell how to scale, or are of the next field."""


def segment_pixels(data: bytes) -> int:
    """Pixels of a JPEG, JPEG 2000, JPEG XL, WebP or PNG by its header; 0 of other bytes."""
    with contextlib.suppress(struct.error, ValueError):  # cut off, for the decoder to judge
        if data.startswith(_JPEG):
            return frame_pixels(data)
        if data.startswith(_PNG):
            width, height = struct.unpack_from(">II", data, 16)
            return int(width * height)
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _webp_pixels(data)
        stream = box(data, b"jp2c") if data.startswith(_JP2) else data
        if stream.startswith(_SIZ):
            right, bottom, left, top = struct.unpack_from(">IIII", stream, 8)
            return int(max(right - left, 0) * max(bottom - top, 0))
        return jxl_pixels(data)
    return 0


def _webp_pixels(data: bytes) -> int:
    kind = data[12:16]
    if kind == b"VP8X":  # of the canvas, 24 bits to a side
        width, height = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
    elif kind == b"VP8L":  # without loss
        (sides,) = struct.unpack_from("<I", data, 21)
        width, height = (sides & _WEBP_SIDE) + 1, (sides >> 14 & _WEBP_SIDE) + 1
    else:
        width, height = (side & _WEBP_SIDE for side in struct.unpack_from("<HH", data, 26))
    return width * height
