"""PNGs: code values as they are, and maps of normals given from top to bottom."""

from __future__ import annotations

from pathlib import Path

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage

from pipeline.images.frames import Image

_ZLIB_LEVEL = 3
"""Level 6 takes twice the time for a hundredth of the size."""


def write_png8(path: Path, codes: NDArray[np.uint8]) -> None:
    """Write 8-bit code values (H, W, 3) as they are. Raises OSError."""
    PillowImage.fromarray(codes).save(path, "PNG", compress_level=_ZLIB_LEVEL)


class NormalsPng:
    """A normal map of 16 bits, given from top to bottom. size: (width, height).

    Normals are written as they are given, in OpenGL's convention or DirectX's: code = (n + 1)/2 ·
    65535. Pixels without one (not finite, or of no length) are 0, 0, 0, which no unit normal gives.
    """

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        width, height = size
        self._path = path
        self._codes = np.empty((height, width, 3), np.uint16)
        self._next = 0

    def write(self, normals: Image) -> None:
        """Take the next rows (h, W, 3) of unit normals."""
        rows = slice(self._next, self._next + len(normals))
        known = np.isfinite(normals).all(axis=2, keepdims=True) & normals.any(axis=2, keepdims=True)
        scaled = np.clip((np.where(known, normals, -1.0) + 1.0) / 2.0, 0.0, 1.0) * 65535
        self._codes[rows] = np.round(scaled)
        self._next = rows.stop

    def close(self) -> None:
        """Encode and write. Raises OSError."""
        self._path.write_bytes(imagecodecs.png_encode(self._codes, level=_ZLIB_LEVEL))
