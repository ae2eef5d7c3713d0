from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numba import njit
from numpy.typing import NDArray
from PIL import Image as PillowImage

from pipeline.colour.curves import linear_to_srgb
from pipeline.colour.icc import srgb_profile
from pipeline.colour.spaces import SRGB_PRIMARIES, rgb_to_xyz
from pipeline.frames import Image, Matrix

QUALITY = 92

_IDENTITY: Matrix = np.eye(3)
_LUMINANCE = rgb_to_xyz(SRGB_PRIMARIES)[1].astype(np.float32)
_STEPS = 65535


def write_jpeg(file: Path | BinaryIO, linear: Image, to_srgb: Matrix = _IDENTITY) -> None:
    """Write (H, W, 3) as an 8-bit sRGB JPEG of quality 92 with its ICC profile and no EXIF.

    linear: linear values, 1.0 = white; to_srgb: matrix (3, 3) that takes a pixel to linear sRGB.
    Colour is not subsampled (4:4:4): the borders between coloured lights are what these pictures
    show. Raises OSError where the file cannot be written.
    """
    PillowImage.fromarray(to_srgb8(linear, to_srgb)).save(
        file, "JPEG", quality=QUALITY, subsampling="4:4:4", icc_profile=srgb_profile()
    )


def to_srgb8(linear: Image, to_srgb: Matrix = _IDENTITY) -> NDArray[np.uint8]:
    """Encode (H, W, 3) linear values as 8-bit sRGB code values.

    Colours that sRGB cannot hold move towards the grey of their own luminance until they fit, so
    that hue stays and no channel is cut off by itself; what is brighter than white is white.
    """
    out = np.empty(linear.shape, dtype=np.uint8)
    _encode(linear, to_srgb.astype(np.float32), _LUMINANCE, _codes(), out)
    return out


@njit(cache=True)
def _encode(
    linear: Image,
    matrix: NDArray[np.float32],
    luminance: NDArray[np.float32],
    codes: NDArray[np.uint8],
    out: NDArray[np.uint8],
) -> None:
    """Take pixels through a matrix, move them into the gamut and look up their code values."""
    zero, one, steps = np.float32(0.0), np.float32(1.0), np.float32(_STEPS)
    height, width = linear.shape[:2]
    rgb = np.empty(3, np.float32)
    for y in range(height):
        for x in range(width):
            first, second, third = linear[y, x, 0], linear[y, x, 1], linear[y, x, 2]
            grey = zero
            for k in range(3):
                rgb[k] = matrix[k, 0] * first + matrix[k, 1] * second + matrix[k, 2] * third
                grey += rgb[k] * luminance[k]
            grey = min(max(grey, zero), one)
            share = one
            for k in range(3):
                away = rgb[k] - grey
                room = one - grey if away > zero else grey
                if abs(away) > room:
                    share = min(share, room / abs(away))
            for k in range(3):
                light = grey + share * (rgb[k] - grey)
                light = min(light, one) if light > zero else zero  # nor is NaN
                out[y, x, k] = codes[int(np.rint(light * steps))]


@cache
def _codes() -> NDArray[np.uint8]:
    """Code value for every step of linear light."""
    code = linear_to_srgb(np.arange(_STEPS + 1) / _STEPS)
    return np.round(code * 255).astype(np.uint8)
