"""Photographs that stay in memory as code values: those of their files, or of their sensor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import DTypeLike, NDArray

from pipeline.arrays import Floats32
from pipeline.images.memory import release_rows


class CodedImage(ABC):
    """A linear photograph (H, W, 3) of code values, made linear where it is looked at.

    Index it as an array: slices give float32 copies. codes: (H, W, 3).
    """

    def __init__(self, codes: NDArray[Any]) -> None:
        self._codes = codes

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

    def __getitem__(self, key: Any) -> Floats32:
        return self._light(np.ascontiguousarray(self._codes[key]))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[:], dtype)

    def write_planes(self, rows: slice, planes: Floats32) -> None:
        """Write some rows into planes (3, h, W)."""
        self._write_planes(np.ascontiguousarray(self._codes[rows]), planes)

    def release_rows(self, stop: int) -> None:
        """Give the memory of the rows before `stop` back, as pipeline.images.memory does."""
        release_rows(self._codes, stop)

    @abstractmethod
    def divided(self, by: float) -> Self:
        """The same photograph, all values divided."""

    @abstractmethod
    def _light(self, codes: NDArray[Any]) -> Floats32:
        """Light of contiguous code values, in their shape."""

    @abstractmethod
    def _write_planes(self, codes: NDArray[Any], planes: Floats32) -> None:
        """Write the light of contiguous code values (h, W, 3) into planes (3, h, W)."""


class TableImage(CodedImage):
    """Of 8 bits, whose light a table tells: a quarter of the memory, and the same values.

    codes: uint8. table: float32 (256,), the light of each code value.
    """

    def __init__(self, codes: NDArray[np.uint8], table: Floats32) -> None:
        super().__init__(codes)
        self._table = table

    def divided(self, by: float) -> Self:
        """Divide the table."""
        return type(self)(self._codes, self._table / np.float32(by))

    def mapped(self, curve: Callable[[Floats32], Floats32]) -> Self:
        """The same photograph, all values through a curve: so does the table."""
        return type(self)(self._codes, curve(self._table))

    def _light(self, codes: NDArray[np.uint8]) -> Floats32:
        if codes.ndim != 3:
            return np.asarray(self._table[codes])
        return np.asarray(cv2.LUT(codes, self._table), dtype=np.float32)

    def _write_planes(self, codes: NDArray[np.uint8], planes: Floats32) -> None:
        from pipeline.images.code_loops import look_up  # numba: the API decodes nothing

        look_up(codes, self._table, planes)


class LevelImage(CodedImage):
    """Of 16 bits, whose light grows evenly: half of the memory.

    codes: uint16. black: the code value without light. step: light between two code values.
    """

    def __init__(self, codes: NDArray[np.uint16], black: float, step: float) -> None:
        super().__init__(codes)
        self._black, self._step = np.float32(black), np.float32(step)

    def divided(self, by: float) -> Self:
        """Divide the step."""
        return type(self)(self._codes, float(self._black), float(self._step) / by)

    def _light(self, codes: NDArray[np.uint16]) -> Floats32:
        from pipeline.images.code_loops import scale  # numba: the API decodes nothing

        light = np.empty(codes.shape, np.float32)
        scale(codes.reshape(-1), self._black, self._step, light.reshape(-1))
        return light

    def _write_planes(self, codes: NDArray[np.uint16], planes: Floats32) -> None:
        from pipeline.images.code_loops import scale_planes  # numba: the API decodes nothing

        scale_planes(codes, self._black, self._step, planes)
