"""What a PNG says of its colours, as the third edition of its specification ranks it."""

from __future__ import annotations

import struct

from pipeline.colour.icc import matrix_profile, srgb_profile
from pipeline.colour.spaces import REC2020_PRIMARIES, SRGB_PRIMARIES
from pipeline.decode.profiles import embedded_profile

_SIGNATURE = 8
_TOLD = (b"cICP", b"sRGB", b"gAMA")
_CODE_POINTS = 4
_P3_PRIMARIES = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))
_PRIMARIES = {9: REC2020_PRIMARIES, 12: _P3_PRIMARIES}
_UNSPECIFIED, _LINEAR = 2, 8
"""Colour primaries and transfer characteristics of Rec. ITU-T H.273; other primaries are rare."""
_SRGB_GAMMA, _LINEAR_GAMMA = 45455, 100_000
_NEAR = 2000
"""Of a gAMA chunk, in 100 000ths, as programs round it."""


def png_transfer(data: bytes) -> int | None:
    """Transfer characteristics of Rec. ITU-T H.273 that a PNG names, None where it names none."""
    coded = _told(data).get(b"cICP", b"")
    return coded[1] if len(coded) == _CODE_POINTS else None


def png_profile(data: bytes) -> bytes | None:
    """ICC profile of a PNG: its own, or one of what its cICP, sRGB or gAMA chunk says.

    None where nothing usable is said. PQ and HLG are to be refused before, by png_transfer.
    """
    told = _told(data)
    coded = told.get(b"cICP", b"")
    if len(coded) == _CODE_POINTS and coded[1] != _UNSPECIFIED:
        return _coded_profile(coded[0], coded[1])
    own = embedded_profile(data)
    if own is not None:
        return own
    if b"sRGB" in told:
        return srgb_profile()
    gamma = int.from_bytes(told.get(b"gAMA", b""), "big")
    if abs(gamma - _SRGB_GAMMA) <= _NEAR:
        return srgb_profile()
    if abs(gamma - _LINEAR_GAMMA) <= _NEAR:
        return matrix_profile("sRGB linear", SRGB_PRIMARIES, "linear")
    return None


def _coded_profile(primaries: int, transfer: int) -> bytes:
    """Build the profile of code points; a curve that is not linear is taken as that of sRGB."""
    known = _PRIMARIES.get(primaries, SRGB_PRIMARIES)
    return matrix_profile("cICP", known, "linear" if transfer == _LINEAR else "srgb")


def _told(data: bytes) -> dict[bytes, bytes]:
    """Return the chunks of interest, all of which come before the pixels."""
    told: dict[bytes, bytes] = {}
    position = _SIGNATURE
    while position + 8 <= len(data):
        length, name = struct.unpack(">I4s", data[position : position + 8])
        if name == b"IDAT":
            break
        if name in _TOLD:
            told[name] = data[position + 8 : position + 8 + length]
        position += length + 12
    return told
