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
from pipeline.frames import Image, Matrix, Numbers, Planes, numbers_of, planes_of

QUALITY = 92

_IDENTITY: Matrix = np.eye(3)
_LUMINANCE = numbers_of(rgb_to_xyz(SRGB_PRIMARIES)[1].astype(np.float32))
_STEPS = 65535


class JpegFile:
    """An 8-bit sRGB JPEG of quality 92 with its ICC profile and no EXIF, given from top to bottom.

    size: (width, height). to_srgb: matrix (3, 3) that takes a pixel to linear sRGB. Colour is not
    subsampled (4:4:4): the borders between coloured lights are what these pictures show. Encoders
    take whole pictures, so that code values are kept until close.
    """

    def __init__(
        self, file: Path | BinaryIO, size: tuple[int, int], to_srgb: Matrix = _IDENTITY
    ) -> None:
        width, height = size
        self._file = file
        self._to_srgb = to_srgb
        self._codes = np.empty((height, width, 3), np.uint8)
        self._next = 0

    def write(self, linear: Image) -> None:
        """Take the next rows (h, W, 3), linear, 1.0 = white."""
        rows = slice(self._next, self._next + len(linear))
        _write_codes(linear, self._to_srgb, self._codes[rows])
        self._next = rows.stop

    def close(self) -> None:
        """Encode and write. Raises OSError where the file cannot be written."""
        PillowImage.fromarray(self._codes).save(
            self._file,
            "JPEG",
            quality=QUALITY,
            subsampling="4:4:4",
            icc_profile=srgb_profile(),
        )


def write_jpeg(file: Path | BinaryIO, linear: Image, to_srgb: Matrix = _IDENTITY) -> None:
    """Write a whole picture (H, W, 3), as JpegFile does."""
    jpeg = JpegFile(file, (linear.shape[1], linear.shape[0]), to_srgb)
    jpeg.write(linear)
    jpeg.close()


def to_srgb8(linear: Image, to_srgb: Matrix = _IDENTITY) -> NDArray[np.uint8]:
    """Encode (H, W, 3) linear values as 8-bit sRGB code values.

    Colours that sRGB cannot hold move towards the grey of their own luminance until they fit, so
    that hue stays and no channel is cut off by itself; what is brighter than white is white.
    """
    codes = np.empty(linear.shape, dtype=np.uint8)
    _write_codes(linear, to_srgb, codes)
    return codes


def _write_codes(linear: Image, to_srgb: Matrix, codes: NDArray[np.uint8]) -> None:
    matrix = numbers_of(to_srgb.astype(np.float32))
    _encode(planes_of(linear), matrix, _LUMINANCE, _codes(), codes)


@njit(cache=True)
def _encode(
    linear: Planes,
    m: Numbers,
    luminance: Numbers,
    codes: NDArray[np.uint8],
    out: NDArray[np.uint8],
) -> None:
    """Take pixels through a matrix, move them into the gamut and look up their code values."""
    zero, one, most = np.float32(0.0), np.float32(1.0), np.float32(_STEPS)
    height, width = linear[0].shape
    steps = np.empty((3, width), np.uint16)
    for y in range(height):
        for x in range(width):
            r, g, b = linear[0][y, x], linear[1][y, x], linear[2][y, x]
            red = np.float32(m[0]) * r + np.float32(m[1]) * g + np.float32(m[2]) * b
            green = np.float32(m[3]) * r + np.float32(m[4]) * g + np.float32(m[5]) * b
            blue = np.float32(m[6]) * r + np.float32(m[7]) * g + np.float32(m[8]) * b
            grey = np.float32(luminance[0]) * red + np.float32(luminance[1]) * green
            grey = min(max(grey + np.float32(luminance[2]) * blue, zero), one)
            share = min(_share(red - grey, grey), _share(green - grey, grey))
            share = min(share, _share(blue - grey, grey))
            steps[0, x] = _step(grey + share * (red - grey), most)
            steps[1, x] = _step(grey + share * (green - grey), most)
            steps[2, x] = _step(grey + share * (blue - grey), most)
        for x in range(width):
            out[y, x, 0], out[y, x, 1] = codes[steps[0, x]], codes[steps[1, x]]
            out[y, x, 2] = codes[steps[2, x]]


@njit(cache=True, inline="always")
def _share(away: np.float32, grey: np.float32) -> np.float32:
    """How far a channel may lie away from grey, against how far it does; at most 1."""
    room = np.float32(1.0) - grey if away > np.float32(0.0) else grey
    share = room / max(abs(away), np.float32(1e-12))
    return min(share, np.float32(1.0))


@njit(cache=True, inline="always")
def _step(light: np.float32, most: np.float32) -> np.uint16:
    light = light if light > np.float32(0.0) else np.float32(0.0)  # nor is NaN
    return np.uint16(np.rint(min(light, np.float32(1.0)) * most))


@cache
def _codes() -> NDArray[np.uint8]:
    """Code value for every step of linear light."""
    code = linear_to_srgb(np.arange(_STEPS + 1) / _STEPS)
    return np.round(code * 255).astype(np.uint8)
