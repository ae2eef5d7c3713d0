from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage

from pipeline.colour.curves import linear_to_srgb
from pipeline.colour.icc import srgb_profile
from pipeline.colour.spaces import SRGB_PRIMARIES, rgb_to_xyz
from pipeline.frames import Image, Matrix
from pipeline.progress import STRIP_ROWS

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
    matrix = np.asarray(to_srgb.T, dtype=np.float32)
    for top in range(0, linear.shape[0], STRIP_ROWS):
        fitting = _into_gamut(linear[top : top + STRIP_ROWS] @ matrix)
        out[top : top + STRIP_ROWS] = _codes()[np.round(fitting * _STEPS).astype(np.uint16)]
    return out


def _into_gamut(rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    grey = np.clip(rgb @ _LUMINANCE, 0.0, 1.0)[..., None]
    away = rgb - grey
    room = np.where(away > 0, 1.0 - grey, grey)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(np.abs(away) > room, room / np.abs(away), 1.0).min(axis=2, keepdims=True)
    fitting: NDArray[np.float32] = np.clip(grey + share * away, 0.0, 1.0)
    return fitting


@cache
def _codes() -> NDArray[np.uint8]:
    """Code value for every step of linear light."""
    code = linear_to_srgb(np.arange(_STEPS + 1) / _STEPS)
    return np.round(code * 255).astype(np.uint8)
