"""Pictures given to a file some rows at a time, as the pipeline does."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from pipeline.arrays import Floats32
from pipeline.encode.writer import Writer

_ROWS = 70


def size_of(picture: NDArray[Any]) -> tuple[int, int]:
    """(width, height)."""
    return picture.shape[1], picture.shape[0]


def write_by_strips(file: Writer, picture: Floats32) -> None:
    """Write a whole picture."""
    for top in range(0, len(picture), _ROWS):
        file.write(picture[top : top + _ROWS])
    file.close()
