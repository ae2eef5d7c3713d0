"""What samples a JPEG XL has, of which its decoder tells the least.

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
    _skip_size(bits)
    if bits.take(1):  # all as is usual
        return JxlSamples(8, False)
    if bits.take(1):  # something beside the picture
        bits.take(3)  # orientation
        if bits.take(1):
            _skip_size(bits)
        if bits.take(2):
            raise ValueError("more than one picture")
    floats = bool(bits.take(1))
    usual = _FLOAT_BITS if floats else _INTEGER_BITS
    choice = bits.take(2)
    return JxlSamples(usual[choice] if choice < len(usual) else 1 + bits.take(6), floats)


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


def _skip_size(bits: _Bits) -> None:
    small = bits.take(1)
    _skip_side(bits, small)
    if not bits.take(3):  # else the width follows from the height
        _skip_side(bits, small)


def _skip_side(bits: _Bits, small: int) -> None:
    bits.take(5 if small else _SIZE_BITS[bits.take(2)])


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
