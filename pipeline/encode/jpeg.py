"""JPEGs in sRGB from linear pictures, encoded some rows at a time."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import BinaryIO

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from pipeline.colour.curves import linear_to_srgb
from pipeline.colour.icc import srgb_profile
from pipeline.colour.spaces import SRGB_PRIMARIES, rgb_to_xyz
from pipeline.compiling import exact, spliced
from pipeline.errors import OptionError
from pipeline.images.by_matrix import by_matrix
from pipeline.images.frames import Image, Matrix, Numbers, Planes, numbers_of, planes_of

_QUALITY = 92

_IDENTITY: Matrix = np.eye(3)
_LUMINANCE = numbers_of(rgb_to_xyz(SRGB_PRIMARIES)[1].astype(np.float32))
_LEAST_GREY = np.float32(0.5)
"""Of the luminance of a colour's channels above 0; of all real lights only deep blue ones have less
by their own luminance, and by a camera's matrix none at all, so that they would be black."""
_STEPS = 65535
_MOST_SIDE = 65500  # of libjpeg
_BLOCK = 8
_ROWS = 4 * _BLOCK
"""Rows encoded at a time; a restart interval counts at most 65535 blocks."""

_FRAME, _SCAN, _END, _RESTART = b"\xff\xc0", b"\xff\xda", b"\xff\xd9", 0xD0


def check_jpeg_size(size: tuple[int, int]) -> None:
    """Raise OptionError for (width, height) of more than 65,500 pixels to a side."""
    width, height = size
    if max(size) > _MOST_SIDE:
        raise OptionError(
            f"A JPEG cannot hold {width} × {height} pixels, as the format ends at {_MOST_SIDE:,} "
            "pixels a side: ask for TIFF or OpenEXR instead."
        )


class JpegFile:
    """An 8-bit sRGB JPEG of quality 92 with its ICC profile, no EXIF, written from top to bottom.

    size: (width, height). to_srgb: matrix (3, 3) that takes a pixel to linear sRGB. Colour is not
    subsampled (4:4:4): the borders between coloured lights are what these pictures show. Encoders
    take whole pictures: some rows at a time are one, and the file joins them by restart markers
    (ITU-T T.81, E.1.4). Raises what check_jpeg_size raises.
    """

    def __init__(
        self, file: Path | BinaryIO, size: tuple[int, int], to_srgb: Matrix = _IDENTITY
    ) -> None:
        width, height = size
        check_jpeg_size(size)
        self._file = file
        self._size = size
        self._to_srgb = to_srgb
        self._codes = np.empty((min(_ROWS, height), width, 3), np.uint8)
        self._waiting = 0
        self._parts = 0
        if isinstance(file, Path):
            file.write_bytes(b"")

    def write(self, linear: Image) -> None:
        """Take the next rows (h, W, 3), linear, 1.0 = white. Raises OSError."""
        while len(linear):
            some = linear[: len(self._codes) - self._waiting]
            end = self._waiting + len(some)
            _write_codes(some, self._to_srgb, self._codes[self._waiting : end])
            self._waiting, linear = end, linear[len(some) :]
            if end == len(self._codes):
                self._encode()

    def close(self) -> None:
        """End the file. Raises OSError."""
        if self._waiting:
            self._encode()
        self._append(_END)

    def _encode(self) -> None:
        """Append the rows that wait; every part but the last has the same number of them."""
        rows = self._codes[: self._waiting]
        jpeg = bytes(imagecodecs.jpeg8_encode(rows, _QUALITY, colorspace="RGB", subsampling="444"))
        scan = jpeg.index(_SCAN)
        start = scan + 2 + int.from_bytes(jpeg[scan + 2 : scan + 4], "big")
        if self._parts == 0:
            before = self._head(jpeg[:scan]) + jpeg[scan:start]
        else:
            before = bytes((0xFF, _RESTART + (self._parts - 1) % 8))
        self._append(before + jpeg[start : -len(_END)])
        self._parts += 1
        self._waiting = 0

    def _head(self, head: bytes) -> bytes:
        """Make the segments before the scan of the first part those of the whole picture."""
        width, height = self._size
        profile = b"ICC_PROFILE\0\1\1" + srgb_profile()
        after_jfif = 4 + int.from_bytes(head[4:6], "big")
        frame = head.index(_FRAME) + 5  # marker, length, precision
        blocks = -(-width // _BLOCK) * (_ROWS // _BLOCK)
        return b"".join(
            (
                head[:after_jfif],
                _segment(0xE2, profile),
                head[after_jfif:frame],
                height.to_bytes(2, "big"),
                head[frame + 2 :],
                _segment(0xDD, blocks.to_bytes(2, "big")),
            )
        )

    def _append(self, data: bytes) -> None:
        if isinstance(self._file, Path):
            with self._file.open("ab") as file:
                file.write(data)
        else:
            self._file.write(data)


def _segment(marker: int, data: bytes) -> bytes:
    return bytes((0xFF, marker)) + (len(data) + 2).to_bytes(2, "big") + data


def write_jpeg(file: Path | BinaryIO, linear: Image, to_srgb: Matrix = _IDENTITY) -> None:
    """Write a whole picture (H, W, 3), as JpegFile does. Raises OptionError, OSError."""
    jpeg = JpegFile(file, (linear.shape[1], linear.shape[0]), to_srgb)
    jpeg.write(linear)
    jpeg.close()


def to_srgb8(linear: Image, to_srgb: Matrix = _IDENTITY) -> NDArray[np.uint8]:
    """Encode (H, W, 3) linear values as 8-bit sRGB code values.

    Colours that sRGB cannot hold move towards the grey of their own luminance until they fit, so
    that hue stays and no channel is cut off by itself; what is brighter than white is white. The
    grey has at least half the luminance of the channels above 0, so that no light becomes black.
    """
    codes = np.empty(linear.shape, dtype=np.uint8)
    _write_codes(linear, to_srgb, codes)
    return codes


def _write_codes(linear: Image, to_srgb: Matrix, codes: NDArray[np.uint8]) -> None:
    matrix = numbers_of(to_srgb.astype(np.float32))
    _encode(planes_of(linear), matrix, _LUMINANCE, _codes(), codes)


@exact
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
            red, green, blue = by_matrix(m, r, g, b)
            grey = _luminance(luminance, red, green, blue)
            lit = _luminance(luminance, max(red, zero), max(green, zero), max(blue, zero))
            grey = min(max(grey, _LEAST_GREY * lit), one)
            share = min(_share(red - grey, grey), _share(green - grey, grey))
            share = min(share, _share(blue - grey, grey))
            steps[0, x] = _step(grey + share * (red - grey), most)
            steps[1, x] = _step(grey + share * (green - grey), most)
            steps[2, x] = _step(grey + share * (blue - grey), most)
        for x in range(width):
            out[y, x, 0], out[y, x, 1] = codes[steps[0, x]], codes[steps[1, x]]
            out[y, x, 2] = codes[steps[2, x]]


@spliced
def _luminance(
    weights: Numbers, red: np.float32, green: np.float32, blue: np.float32
) -> np.float32:
    light = np.float32(weights[0]) * red + np.float32(weights[1]) * green
    return light + np.float32(weights[2]) * blue


@spliced
def _share(away: np.float32, grey: np.float32) -> np.float32:
    """How far a channel may lie away from grey, against how far it does; at most 1."""
    room = np.float32(1.0) - grey if away > np.float32(0.0) else grey
    share = room / max(abs(away), np.float32(1e-12))
    return min(share, np.float32(1.0))


@spliced
def _step(light: np.float32, most: np.float32) -> np.uint16:
    light = light if light > np.float32(0.0) else np.float32(0.0)  # nor is NaN
    return np.uint16(np.rint(min(light, np.float32(1.0)) * most))


@cache
def _codes() -> NDArray[np.uint8]:
    """Code value for every step of linear light."""
    code = linear_to_srgb(np.arange(_STEPS + 1) / _STEPS)
    return np.round(code * 255).astype(np.uint8)
