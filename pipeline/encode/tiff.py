"""16-bit TIFFs, in colour or grey, written from top to bottom."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from pipeline.colour.icc import linear_rec2020_profile
from pipeline.compiling import exact, spliced
from pipeline.images.by_matrix import by_matrix
from pipeline.images.frames import Image, Matrix, Numbers, Plane, Planes, numbers_of, planes_of
from pipeline.images.strips import STRIP_ROWS

_IDENTITY: Matrix = np.eye(3)
_WHITE = 65535


class _Tiff:
    """An uncompressed 16-bit TIFF whose rows follow its head, so that they can be appended.

    Deflating noisy 16-bit values takes thirty times as long and saves little.
    """

    def __init__(self, path: Path, shape: tuple[int, ...], **tags: Any) -> None:
        place = tifffile.imwrite(
            path,
            shape=shape,
            dtype=np.uint16,
            rowsperstrip=STRIP_ROWS,
            software=False,
            metadata=None,
            returnoffset=True,
            **tags,
        )
        if place is None:
            raise ValueError("a TIFF of no pixels has no place for them")
        self._path = path
        self._end = place[0]

    def append(self, codes: NDArray[np.uint16]) -> None:
        with self._path.open("r+b") as file:
            file.seek(self._end)
            self._end += file.write(codes.data)

    def close(self) -> None:
        """Nothing is left to do."""


class TiffFile(_Tiff):
    """A 16-bit TIFF in linear Rec. 2020 with its ICC profile, written from top to bottom.

    size: (width, height). to_rec2020: matrix (3, 3) that takes a pixel to linear Rec. 2020. The
    values stay linear so that in an editor the layers add up to the photograph by "Linear Dodge
    (Add)"; the wide primaries hold what lamps shine. Raises OSError.
    """

    def __init__(self, path: Path, size: tuple[int, int], to_rec2020: Matrix = _IDENTITY) -> None:
        width, height = size
        profile = linear_rec2020_profile()
        super().__init__(path, (height, width, 3), photometric="rgb", iccprofile=profile)
        self._matrix = numbers_of(to_rec2020)

    def write(self, linear: Image) -> None:
        """Write the next rows (h, W, 3), 1.0 = white; what lies outside 0 to 1 is cut off."""
        self.append(codes_of(linear, self._matrix))


class GrayTiffFile(_Tiff):
    """A 16-bit TIFF of linear grey, written from top to bottom. size: (width, height)."""

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        super().__init__(path, size[::-1], photometric="minisblack")

    def write(self, plane: Plane) -> None:
        """Write the next rows (h, W), 0 to 1. Raises OSError."""
        self.append(np.round(np.clip(plane, 0.0, 1.0) * _WHITE).astype(np.uint16))


def codes_of(linear: Image, matrix: Numbers) -> NDArray[np.uint16]:
    """Take a picture (h, W, 3), 1.0 = white, through a matrix and round it to 16 bits."""
    codes = np.empty(linear.shape, np.uint16)
    _encode(planes_of(linear), matrix, codes)
    return codes


@exact
def _encode(linear: Planes, m: Numbers, codes: NDArray[np.uint16]) -> None:
    """Take pixels through a matrix and round them to 16 bits."""
    for y in range(codes.shape[0]):
        for x in range(codes.shape[1]):
            r, g, b = by_matrix(m, linear[0][y, x], linear[1][y, x], linear[2][y, x])
            codes[y, x, 0], codes[y, x, 1], codes[y, x, 2] = _code(r), _code(g), _code(b)


@spliced
def _code(light: np.float32) -> np.int32:
    inside = min(max(light, np.float32(0.0)), np.float32(1.0))
    return np.int32(np.rint(inside * np.float32(_WHITE)))
