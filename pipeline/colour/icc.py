"""ICC profiles of RGB spaces, built from their primaries (ICC.1:2001-04, matrix/TRC)."""

from __future__ import annotations

import struct
from functools import cache
from typing import Literal

import numpy as np

from pipeline.arrays import Floats64
from pipeline.colour.curves import srgb_to_linear
from pipeline.colour.spaces import (
    ADOBE_RGB_PRIMARIES,
    D65_XY,
    REC2020_PRIMARIES,
    SRGB_PRIMARIES,
    Primaries,
    adaptation,
    rgb_to_xyz,
    xy_to_xyz,
)

_D50 = np.array([0.9642, 1.0, 0.8249])
"""White of the profile connection space, ICC.1:2001-04, 6.1.13."""
_VERSION = 0x02400000
_DATE = (2020, 1, 1, 0, 0, 0)
"""The same for ever: equal profiles are to be equal bytes."""
_CURVE_POINTS = 1024
_ADOBE_GAMMA = 2.19921875
"""Adobe RGB (1998), 4.3.4.2."""
_COPYRIGHT = b"No copyright, use freely"


@cache
def linear_rec2020_profile() -> bytes:
    """Return the ICC profile of Rec. 2020 primaries with linear values."""
    return matrix_profile("Rec. 2020 linear", REC2020_PRIMARIES, "linear")


@cache
def srgb_profile() -> bytes:
    """Return the ICC profile of sRGB, IEC 61966-2-1."""
    return matrix_profile("sRGB", SRGB_PRIMARIES, "srgb")


@cache
def adobe_rgb_profile() -> bytes:
    """Return an ICC profile of Adobe RGB (1998)."""
    return matrix_profile("Adobe RGB (1998)", ADOBE_RGB_PRIMARIES, _ADOBE_GAMMA)


def matrix_profile(
    name: str,
    primaries: Primaries,
    curve: Literal["linear", "srgb"] | float,
    white: tuple[float, float] = D65_XY,
) -> bytes:
    """Return a version 2.4 display profile of an RGB space.

    name: ASCII description. curve: how code values become light, a number as their power, 0.01 to
    255. white: CIE xy of (1, 1, 1).
    """
    adapt = adaptation(xy_to_xyz(white), _D50)
    colorants = adapt @ rgb_to_xyz(primaries, white)
    if isinstance(curve, float):
        trc = _gamma_curve(curve)
    else:
        trc = _linear_curve() if curve == "linear" else _srgb_curve()
    tags = {
        b"desc": _description(name.encode("ascii")),
        b"cprt": b"text" + bytes(4) + _COPYRIGHT + b"\0",
        b"wtpt": _xyz(_D50),
        b"chad": b"sf32" + bytes(4) + _s15f16(adapt.ravel()),
        b"rXYZ": _xyz(colorants[:, 0]),
        b"gXYZ": _xyz(colorants[:, 1]),
        b"bXYZ": _xyz(_D50 - _rounded(colorants[:, 0]) - _rounded(colorants[:, 1])),
        b"rTRC": trc,
        b"gTRC": trc,
        b"bTRC": trc,
    }
    start = 128 + 4 + 12 * len(tags)
    table, body, places = b"", b"", dict[bytes, int]()
    for signature, data in tags.items():
        if data not in places:  # the three curves share one place
            places[data] = start + len(body)
            body += data + bytes(-len(data) % 4)
        table += signature + struct.pack(">II", places[data], len(data))
    return _header(start + len(body)) + struct.pack(">I", len(tags)) + table + body


def _header(size: int) -> bytes:
    return (
        struct.pack(">I4xI", size, _VERSION)
        + b"mntrRGB XYZ "
        + struct.pack(">6H", *_DATE)
        + b"acsp"
        + bytes(28)
        + _s15f16(_D50)
        + bytes(48)
    )


def _srgb_curve() -> bytes:
    light = srgb_to_linear(np.linspace(0.0, 1.0, _CURVE_POINTS))
    points = np.round(light * 65535).astype(">u2").tobytes()
    return b"curv" + bytes(4) + struct.pack(">I", _CURVE_POINTS) + points


def _linear_curve() -> bytes:
    return b"curv" + bytes(4) + struct.pack(">I", 0)


def _gamma_curve(gamma: float) -> bytes:
    return b"curv" + bytes(4) + struct.pack(">IH", 1, round(gamma * 256))  # u8Fixed8Number


def _description(name: bytes) -> bytes:
    ascii_part = struct.pack(">I", len(name) + 1) + name + b"\0"
    return b"desc" + bytes(4) + ascii_part + bytes(8 + 3 + 67)  # no Unicode, no ScriptCode


def _xyz(values: Floats64) -> bytes:
    return b"XYZ " + bytes(4) + _s15f16(values)


def _rounded(values: Floats64) -> Floats64:
    return np.round(values * 65536) / 65536


def _s15f16(values: Floats64) -> bytes:
    return np.round(values * 65536).astype(">i4").tobytes()
