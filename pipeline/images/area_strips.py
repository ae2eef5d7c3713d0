"""Pictures in a smaller size while their rows come, each pixel the mean of the area it covers."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import Floats32
from pipeline.compiling import compiled
from pipeline.images.frames import Image


class AreaStrips:
    """Area means of a picture that comes strip by strip, but for rounding those of the whole.

    size, smaller: (width, height) of the picture, and what it is reduced to.
    """

    def __init__(self, size: tuple[int, int], smaller: tuple[int, int]) -> None:
        self._size = size
        self._smaller = smaller
        self._taken = 0
        self._begun = np.zeros((0, 3 * size[0]), np.float32)

    def add(self, rows: Image) -> Image:
        """Take the next rows (h, W, 3); returns the reduced rows (n, w, 3) that they complete."""
        if self._size == self._smaller:
            return rows
        (full, height), (width, fewer) = self._size, self._smaller
        top, self._taken = self._taken, self._taken + len(rows)
        first, complete = top * fewer // height, self._taken * fewer // height
        # rows are made fewer before they are made narrow, which costs more
        sums = np.zeros((-(-self._taken * fewer // height) - first, 3 * full), np.float32)
        sums[: len(self._begun)] = self._begun
        same = np.ascontiguousarray(rows, np.float32).reshape(len(rows), -1)
        _share_out(same, top, height, fewer, sums)
        self._begun = sums[complete - first :].copy()
        if complete == first:
            return np.zeros((0, width, 3), np.float32)
        means = sums[: complete - first].reshape(-1, full, 3)
        narrow = cv2.resize(means, (width, len(means)), interpolation=cv2.INTER_AREA)
        return np.asarray(narrow, np.float32)


@compiled
def _share_out(rows: Floats32, top: int, height: int, fewer: int, sums: Floats32) -> None:
    """Add rows (n, w) of so many, from `top` on, to the fewer rows (m, w) that they belong to.

    sums: of the reduced rows from that on to which row `top` belongs.
    """
    first = top * fewer // height
    for y in range(len(rows)):
        # in units in which a row is `fewer` high, and a reduced one `height`
        above = (top + y) * fewer
        reduced = above // height
        inside = min((reduced + 1) * height - above, fewer)
        _add(rows[y], np.float32(inside / height), sums[reduced - first])
        if inside < fewer:
            _add(rows[y], np.float32((fewer - inside) / height), sums[reduced + 1 - first])


@compiled
def _add(row: Floats32, weight: np.float32, total: Floats32) -> None:
    for i in range(len(row)):
        total[i] += weight * row[i]
