"""What a PNG says of its colours, as the third edition of its specification ranks it."""

from __future__ import annotations

import struct
import zlib
from typing import Literal

import numpy as np

from pipeline.colour.icc import matrix_profile, srgb_profile
from pipeline.colour.spaces import D65_XY, REC2020_PRIMARIES, SRGB_PRIMARIES
from pipeline.decode.profiles import profile_of_chromaticities
from pipeline.decode.samples import UnsuitableError

_SIGNATURE = 8
_TOLD = (b"cICP", b"iCCP", b"sRGB", b"gAMA", b"cHRM")
_CODE_POINTS = 4
_MOST_PROFILE = 2**24
"""Bytes; those of tables for three colours have some millions."""
_P3_PRIMARIES = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))
_PRIMARIES = {9: REC2020_PRIMARIES, 12: _P3_PRIMARIES}
_UNSPECIFIED, _LINEAR = 2, 8
"""Colour primaries and transfer characteristics of Rec. ITU-T H.273; other primaries are rare."""
_SRGB_GAMMA, _LINEAR_GAMMA = 45455, 100_000
_NEAR = 2000
"""Of a gAMA chunk, in 100 000ths, as programs round it."""
_GAMMAS = (20_000, 500_000)
"""What a gAMA chunk can mean; anything else says nothing."""
_CHROMATICITIES = struct.Struct(">8I")
_SRGB_CHROMATICITIES = (*np.ravel(SRGB_PRIMARIES).tolist(), *D65_XY)
_SAME_XY = 0.002
_BIT_DEPTH = 24


def png_transfer(data: bytes) -> int | None:
    """Transfer characteristics of Rec. ITU-T H.273 that a PNG names, None where it names none."""
    coded = _told(data).get(b"cICP", b"")
    return coded[1] if len(coded) == _CODE_POINTS else None


def refuse_limited_range(data: bytes) -> None:
    """Raise UnsuitableError for a PNG whose cICP chunk says that black and white are video's."""
    coded = _told(data).get(b"cICP", b"")
    if len(coded) == _CODE_POINTS and not coded[3]:
        raise UnsuitableError(
            "is in the limited range of video, where black is not 0: save it in full range."
        )


def png_profile(data: bytes) -> bytes | None:
    """ICC profile of a PNG: its own, or one of what its cICP, sRGB, gAMA or cHRM chunk says.

    None where nothing is said, and bytes that are no profile where an ICC profile is damaged and
    nothing else is said. PQ and HLG are to be refused before, by png_transfer.
    """
    told = _told(data)
    coded = told.get(b"cICP", b"")
    if len(coded) == _CODE_POINTS and coded[1] != _UNSPECIFIED:
        return _coded_profile(coded[0], coded[1])
    packed = told.get(b"iCCP")
    own = None if packed is None else _unpacked(packed)
    if own is not None:
        return own
    if b"sRGB" in told:
        return srgb_profile()
    gamma = int.from_bytes(told.get(b"gAMA", b""), "big")
    known = _GAMMAS[0] <= gamma <= _GAMMAS[1]
    primaries = told.get(b"cHRM", b"")
    if len(primaries) == _CHROMATICITIES.size:
        numbers = np.array(_CHROMATICITIES.unpack(primaries)) / 100_000
        chromaticities = (*numbers[2:].tolist(), *numbers[:2].tolist())  # white comes first there
        curve = _curve(gamma, chromaticities) if known else _usual_curve(data)
        profile = profile_of_chromaticities("cHRM", chromaticities, curve)
        if profile is not None:
            return profile
    if not known:
        return packed
    return matrix_profile("gAMA", SRGB_PRIMARIES, _curve(gamma, _SRGB_CHROMATICITIES))


def _unpacked(chunk: bytes) -> bytes | None:
    """Give the profile of an iCCP chunk; None of a damaged one, or of more than a profile has."""
    _name, _, packed = chunk.partition(b"\0")
    stream = zlib.decompressobj()
    try:
        profile = stream.decompress(packed[1:], _MOST_PROFILE)  # after the number of the method
    except zlib.error:
        return None
    return profile if stream.eof and profile else None


def _curve(gamma: int, chromaticities: tuple[float, ...]) -> Literal["linear", "srgb"] | float:
    """Tell what a gAMA chunk means: 1/2.2 with the colours of sRGB its curve, else a power."""
    if abs(gamma - _LINEAR_GAMMA) <= _NEAR:
        return "linear"
    in_srgb = np.allclose(chromaticities, _SRGB_CHROMATICITIES, rtol=0, atol=_SAME_XY)
    if abs(gamma - _SRGB_GAMMA) <= _NEAR and in_srgb:
        return "srgb"
    return _LINEAR_GAMMA / gamma


def _usual_curve(data: bytes) -> Literal["linear", "srgb"]:
    """Curve of a PNG that tells none, as of one that tells nothing."""
    return "linear" if data[_BIT_DEPTH] == 16 else "srgb"


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
