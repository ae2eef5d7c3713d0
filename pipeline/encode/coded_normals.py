"""Normals of a whole photograph in half the memory."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.images.frames import Image

_LARGEST = np.float32(32767)
_UNKNOWN = -32768


class CodedNormals:
    """Unit normals (H, W, 3) as 16-bit integers, to 1.5e-5; NaN where unknown.

    Index them as an array: slices of rows give float32 copies. shape: (H, W, 3).
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._codes: NDArray[np.int16] = np.full(shape, _UNKNOWN, np.int16)
        self._next = 0

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W, 3)."""
        return self._codes.shape

    def add(self, normals: Image) -> None:
        """Take the next rows (h, W, 3), each component -1…1, or NaN."""
        rows = slice(self._next, self._next + len(normals))
        scaled = np.rint(normals * _LARGEST)
        self._codes[rows] = np.where(np.isfinite(scaled), scaled, np.float32(_UNKNOWN))
        self._next = rows.stop

    def __getitem__(self, key: Any) -> Image:
        codes = self._codes[key]
        normals = np.asarray(codes / _LARGEST, np.float32)
        normals[codes == _UNKNOWN] = np.nan
        return normals
