"""How large a JPEG XL is, and what samples it has, before it is decoded.

Sources: ISO/IEC 18181-1 (SizeHeader, ImageMetadata, BitDepth) and 18181-2 (boxes).
"""

from __future__ import annotations

from typing import NamedTuple

from pipeline.decode.boxes import boxes

_CODESTREAM = b"\xff\x0a"
_CONTAINER = b"\0\0\0\x0cJXL \r\n\x87\n"
_HEADER_BYTES = 64
"""More than what comes before the number of bits."""
_SIZE_BITS = (9, 13, 18, 30)
_RATIOS = ((1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))
"""Of width to height, where the width follows from it."""
_INTEGER_BITS = (8, 10, 12)
_FLOAT_BITS = (32, 16, 24)
"""What two bits stand for; of the fourth choice six more bits tell."""


class JxlSamples(NamedTuple):
    """Bits of each sample, 1–64, and whether they are floats."""

    bits: int
    floats: bool


def jxl_samples(data: bytes) -> JxlSamples:
    """Read what samples the JPEG XL has, bare or in a container, that data begins with.

    Raises ValueError for anything else, and for pictures with a preview of their own or that move.
    """
    bits = _Bits(_codestream(data))
    _take_size(bits)
    if bits.take(1):  # all as is usual
        return JxlSamples(8, False)
    if bits.take(1):  # something beside the picture
        bits.take(3)  # orientation
        if bits.take(1):
            _take_size(bits)
        if bits.take(2):
            raise ValueError("more than one picture")
    floats = bool(bits.take(1))
    usual = _FLOAT_BITS if floats else _INTEGER_BITS
    choice = bits.take(2)
    return JxlSamples(usual[choice] if choice < len(usual) else 1 + bits.take(6), floats)


def jxl_pixels(data: bytes) -> int:
    """Pixels of the JPEG XL, bare or in a container, that data begins with.

    Raises ValueError for anything else.
    """
    height, width = _take_size(_Bits(_codestream(data)))
    return height * width


class _Bits:
    """Takes bits from the least one of the first byte on."""

    def __init__(self, data: bytes) -> None:
        self._left = len(data) * 8
        self._bits = int.from_bytes(data, "little")

    def take(self, count: int) -> int:
        self._left -= count
        if self._left < 0:
            raise ValueError("the header of a JPEG XL is cut off")
        value = self._bits & ((1 << count) - 1)
        self._bits >>= count
        return value


def _take_size(bits: _Bits) -> tuple[int, int]:
    """(height, width)."""
    small = bits.take(1)
    height = _take_side(bits, small)
    ratio = bits.take(3)
    if not ratio:
        return height, _take_side(bits, small)
    over, under = _RATIOS[ratio - 1]
    return height, height * over // under


def _take_side(bits: _Bits, small: int) -> int:
    if small:
        return 8 * (bits.take(5) + 1)
    return bits.take(_SIZE_BITS[bits.take(2)]) + 1


def _codestream(data: bytes) -> bytes:
    """Begin of the codestream after its signature."""
    if data.startswith(_CONTAINER):
        pictures = (one for one in boxes(data) if one[0] in (b"jxlc", b"jxlp"))
        name, data = next(pictures, (b"", b""))
        if not name:
            raise ValueError("a JPEG XL without a picture")
        data = data[4:] if name == b"jxlp" else data  # parts have a number
    start = data[:_HEADER_BYTES]
    if not start.startswith(_CODESTREAM):
        raise ValueError("no JPEG XL")
    return start.removeprefix(_CODESTREAM)
