"""Pictures whose colours are not those of sRGB: Display P3 of phones, Adobe RGB of cameras."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, Literal

import cv2
import imagecodecs
import numpy as np
from numpy.typing import NDArray
from PIL.JpegImagePlugin import JpegImageFile

from pipeline.arrays import Floats64
from pipeline.colour.curves import srgb_to_linear
from pipeline.colour.icc import matrix_profile
from pipeline.colour.spaces import SRGB_PRIMARIES
from pipeline.images.frames import Image

_SAME = 0.004
"""Linear light by which a profile may differ from sRGB and count as sRGB: one code value."""
_STRAIGHT = 0.02
"""Of white, by which the light of greys may differ from a line; a gamma of 1.1 does by 0.035."""
_GREYS = 256
"""Codes whose light is looked at."""
_DARKEST_MIDDLE = 0.1
"""Light of the middle code: .21 by sRGB, .16 by a gamma of 2.6, .08 by HLG and .01 by PQ."""
_ROUNDING = 2e-6
"""Linear light by which tables may differ from the colour management they stand for."""
_LEAST_AREA = 0.01
"""Twice that of the triangle of primaries in CIE xy; sRGB has 0.22."""
_UNNAMED_PRIMARIES = (1, 2)
"""Colour primaries of Rec. ITU-T H.273: those of sRGB, and unspecified."""
_LINEAR_TRANSFER = 8
"""Of its transfer characteristics."""


def embedded_profile(data: bytes) -> bytes | None:
    """ICC profile of a JPEG, None where there is none that can be read."""
    try:  # not by Pillow's open, which has a limit of pixels of its own, below ours
        with JpegImageFile(io.BytesIO(data)) as image:
            profile = image.info.get("icc_profile")
    except Exception:  # the decoder of the pixels judges the file, not Pillow
        return None
    return profile if isinstance(profile, bytes) else None


def nclx_profile(nclx: Mapping[str, Any]) -> bytes | None:
    """Build the profile of a HEIF `nclx` description; a curve is taken as that of sRGB."""
    curve: Literal["linear", "srgb"] = (
        "linear" if nclx.get("transfer_characteristics") == _LINEAR_TRANSFER else "srgb"
    )
    if nclx.get("color_primaries", 2) in _UNNAMED_PRIMARIES:
        return matrix_profile("nclx", SRGB_PRIMARIES, curve) if curve == "linear" else None
    red, green, blue = (
        (nclx[f"color_primary_{name}_x"], nclx[f"color_primary_{name}_y"])
        for name in ("red", "green", "blue")
    )
    return matrix_profile("nclx", (red, green, blue), curve)


def profile_of_chromaticities(
    name: str, chromaticities: Sequence[float], curve: Literal["linear", "srgb"] | float
) -> bytes | None:
    """Build the profile of a space by CIE xy of red, green, blue and white, eight numbers.

    curve: as matrix_profile has it. None where these are no colours: a triangle of hardly any
    area, or white outside of it.
    """
    red, green, blue, white = ((x, y) for x, y in np.reshape(chromaticities, (4, 2)).tolist())
    corners = np.array([(x, y, 1.0 - x - y) for x, y in (red, green, blue, white)])
    if not (np.isfinite(corners).all() and corners[:, 1].all()):
        return None
    if not abs(np.linalg.det(corners[:3])) > _LEAST_AREA:
        return None
    if not (np.linalg.solve(corners[:3].T, corners[3]) > 0).all():
        return None
    return matrix_profile(name, (red, green, blue), curve, white)


def differs_from_srgb(profile: bytes) -> bool:
    """Whether an RGB profile says other colours than sRGB; False for one of no use."""
    probe = _probe(np.dtype(np.uint8))
    try:
        light = profile_to_linear(probe, profile)
    except imagecodecs.CmsError:
        return False
    as_srgb = srgb_to_linear((probe / 255).astype(np.float32))
    return float(np.abs(light - as_srgb).max()) > _SAME


def is_curved(profile: bytes) -> bool:
    """Whether code values of an RGB profile are not linear; False for one of no use."""
    return _bend(profile) > _STRAIGHT


def is_straight(profile: bytes) -> bool:
    """Whether code values of an RGB profile are linear; False for one of no use."""
    return _bend(profile) <= _STRAIGHT


def is_hdr(profile: bytes) -> bool:
    """Whether greys of an RGB profile are as dark as PQ and HLG code them, which go beyond white.

    False for one of no use.
    """
    return float(_greys(profile)[_GREYS // 2]) < _DARKEST_MIDDLE


def _bend(profile: bytes) -> float:
    """Of white, by which the light of greys differs from a line; NaN for a profile of no use."""
    return float(np.abs(_greys(profile) - np.linspace(0, 1, _GREYS)).max())


def _greys(profile: bytes) -> Floats64:
    """Light of greys from black to white, 1; NaN for a profile of no use."""
    codes = np.linspace(0, 65535, _GREYS).astype(np.uint16)
    try:
        light = profile_to_linear(np.repeat(codes[None, :, None], 3, axis=2), profile)[0, :, 1]
    except imagecodecs.CmsError:
        return np.full(_GREYS, math.nan)
    return light / np.float64(light[-1]) if light[-1] > 0 else np.full(_GREYS, math.nan)


def to_linear_srgb(profile: bytes, kind: np.dtype[Any]) -> Callable[[NDArray[Any]], Image]:
    """Return what profile_to_linear does to values of a profile, but faster to integers.

    kind: uint8, uint16 or float32. Nearly all profiles of pictures are a curve per channel and a
    matrix: both are read off what the colour management makes of grey steps of each channel, and
    stand for it where they give the same; of floats the matrix alone. Raises imagecodecs.CmsError.
    """
    if kind.kind == "f":
        return _floats_to_linear_srgb(profile)
    axes = np.zeros((3, np.iinfo(kind).max + 1, 3), dtype=kind)
    for channel in range(3):
        axes[channel, :, channel] = np.arange(axes.shape[1])
    light = profile_to_linear(axes, profile)
    matrix = light[:, -1].T.copy()  # of full red, green and blue
    strongest = np.abs(matrix).argmax(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        curves = np.stack([light[k, :, strongest[k]] / matrix[strongest[k], k] for k in range(3)])
    table = np.ascontiguousarray(curves.T[None])

    def by_table(codes: NDArray[Any]) -> Image:
        return np.asarray(cv2.transform(cv2.LUT(codes, table), matrix))

    probe = _probe(kind)
    if np.abs(by_table(probe) - profile_to_linear(probe, profile)).max() <= _ROUNDING:
        return by_table
    return lambda codes: profile_to_linear(codes, profile)


def _floats_to_linear_srgb(profile: bytes) -> Callable[[NDArray[Any]], Image]:
    matrix = profile_to_linear(np.eye(3, dtype=np.float32)[None], profile)[0].T.copy()

    def by_matrix(values: NDArray[Any]) -> Image:
        return np.asarray(cv2.transform(values, matrix))

    probe = (_probe(np.dtype(np.uint16)) / 65535).astype(np.float32)
    if np.abs(by_matrix(probe) - profile_to_linear(probe, profile)).max() <= _SAME:
        return by_matrix  # which goes on above white, where a linear table of points would end
    return lambda values: profile_to_linear(values, profile)


def profile_to_linear(codes: NDArray[Any], profile: bytes) -> Image:
    """Linear sRGB of values (H, W, 3): uint8 or uint16, white at their largest, or float32 at 1.

    Colours outside sRGB keep their negative parts. Raises imagecodecs.CmsError.
    """
    linear: Image = imagecodecs.cms_transform(
        np.ascontiguousarray(codes),
        profile,
        _linear_srgb(),
        colorspace="rgb",
        outcolorspace="rgb",
        outdtype="float32",
    )
    return linear


def _probe(kind: np.dtype[Any]) -> NDArray[Any]:
    """Code values all over the cube of colours (16, 256, 3)."""
    ramp = np.linspace(0, np.iinfo(kind).max, 16).astype(kind)
    return np.stack(np.meshgrid(ramp, ramp, ramp), axis=-1).reshape(16, -1, 3)


@cache
def _linear_srgb() -> bytes:
    return matrix_profile("sRGB linear", SRGB_PRIMARIES, "linear")
