"""PNG files that promise more pixels than their bytes seem to hold."""

from __future__ import annotations

import struct
import zlib

_ROWS = 100  # of one deflated block


def png_of(width: int, height: int, body: bytes = b"", interlaced: bool = False) -> bytes:
    """A PNG of 8-bit RGB; body: its image data as they are deflated, which need not be sound."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        checked = kind + data
        return struct.pack(">I", len(data)) + checked + struct.pack(">I", zlib.crc32(checked))

    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, interlaced))
        + chunk(b"IDAT", body)
        + chunk(b"IEND", b"")
    )


def png_bomb(width: int, height: int) -> bytes:
    """A sound PNG, all black, in some megabytes: one deflated block of zeros over and over.

    height: a multiple of 100.
    """
    packer = zlib.compressobj(9, wbits=-15)
    packed = packer.compress(bytes(_ROWS * (3 * width + 1))) + packer.flush(zlib.Z_FULL_FLUSH)
    adler = struct.pack(">HH", height * (3 * width + 1) % 65521, 1)  # of zeros
    return png_of(width, height, b"\x78\xda" + packed * (height // _ROWS) + b"\x03\x00" + adler)
