"""Photographs that stay in memory as code values: those of their files, or of their sensor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import DTypeLike, NDArray

from pipeline.arrays import Floats32
from pipeline.compiling import exact
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
        _look_up(codes, self._table, planes)


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
        light = np.empty(codes.shape, np.float32)
        _scale(codes.reshape(-1), self._black, self._step, light.reshape(-1))
        return light

    def _write_planes(self, codes: NDArray[np.uint16], planes: Floats32) -> None:
        _scale_planes(codes, self._black, self._step, planes)


@exact
def _look_up(codes: NDArray[np.uint8], table: Floats32, planes: Floats32) -> None:
    """Write the light that a table tells into planes (3, h, W)."""
    for y in range(codes.shape[0]):
        for k in range(3):
            for x in range(codes.shape[1]):
                planes[k, y, x] = table[codes[y, x, k]]


@exact
def _scale(codes: NDArray[np.uint16], black: np.float32, step: np.float32, light: Floats32) -> None:
    """Write light (n,) that grows evenly with codes (n,)."""
    for i in range(len(codes)):
        light[i] = (np.float32(codes[i]) - black) * step


@exact
def _scale_planes(
    codes: NDArray[np.uint16], black: np.float32, step: np.float32, planes: Floats32
) -> None:
    """The same into planes (3, h, W); a row is light before its channels are told apart."""
    width = codes.shape[1]
    light = np.empty(3 * width, np.float32)
    for y in range(codes.shape[0]):
        _scale(codes[y].reshape(-1), black, step, light)
        for x in range(width):
            planes[0, y, x], planes[1, y, x] = light[3 * x], light[3 * x + 1]
            planes[2, y, x] = light[3 * x + 2]
