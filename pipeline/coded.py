"""Photographs that stay in memory as the code values of their files."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import DTypeLike, NDArray

from pipeline.memory import release_rows

Image = NDArray[np.float32]


class CodedImage:
    """A linear photograph (H, W, 3) of 8-bit code values, made linear where it is looked at.

    It takes a quarter of what float32 pixels take, and holds the same values. Index it as an array:
    slices give float32 copies. codes: uint8 (H, W, 3). table: float32 (256,), the light of each
    code value.
    """

    def __init__(self, codes: NDArray[np.uint8], table: NDArray[np.float32]) -> None:
        self._codes = codes
        self._table = table

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W, 3)."""
        return self._codes.shape

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return self._codes.ndim

    def __len__(self) -> int:
        return len(self._codes)

    def __getitem__(self, key: Any) -> Image:
        codes = np.ascontiguousarray(self._codes[key])
        if codes.ndim != 3:
            return np.asarray(self._table[codes])
        return np.asarray(cv2.LUT(codes, self._table), dtype=np.float32)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[:], dtype)

    def rows_by_planes(self, rows: slice) -> Image:
        """Some rows (h, W, 3), each channel contiguous, as compiled loops want them."""
        codes = self._codes[rows]
        planes = np.empty((codes.shape[2], *codes.shape[:2]), np.float32)
        for channel, plane in zip(cv2.split(codes), planes, strict=True):
            cv2.LUT(channel, self._table, dst=plane)
        return np.moveaxis(planes, 0, -1)

    def divided(self, by: float) -> CodedImage:
        """The same photograph, all values divided."""
        return CodedImage(self._codes, self._table / np.float32(by))

    def release_rows(self, stop: int) -> None:
        """Give the memory of the rows before `stop` back, as pipeline.memory does."""
        release_rows(self._codes, stop)
