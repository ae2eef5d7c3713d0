"""The texture of a mesh, made while the rows of its picture come."""

from __future__ import annotations

import io

from pipeline.encode.jpeg import JpegFile
from pipeline.images.area_means import size_within
from pipeline.images.area_strips import AreaStrips
from pipeline.images.frames import Image, Matrix

_MOST_SIDE = 4096  # pixels of a texture that every viewer can show


class Texture:
    """A picture as a JPEG for a mesh, made smaller and encoded while its rows come.

    size: (width, height) of the picture. to_srgb: matrix (3, 3) to linear sRGB.
    """

    def __init__(self, size: tuple[int, int], to_srgb: Matrix) -> None:
        smaller = size_within(size, _MOST_SIDE)
        self._file = io.BytesIO()
        self._jpeg = JpegFile(self._file, smaller, to_srgb)
        self._reduced = AreaStrips(size, smaller)

    def write(self, rows: Image) -> None:
        """Take the next rows (h, W, 3), linear, 1.0 = white."""
        self._jpeg.write(self._reduced.add(rows))

    def close(self) -> bytes:
        """Return the JPEG of all rows."""
        self._jpeg.close()
        return self._file.getvalue()
