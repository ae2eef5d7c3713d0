"""Pictures in a smaller size while their rows come, each pixel the mean of the area it covers."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.images.frames import Image


class AreaStrips:
    """Area means of a picture that comes strip by strip, but for rounding those of the whole.

    size, smaller: (width, height) of the picture, and what it is reduced to.
    """

    def __init__(self, size: tuple[int, int], smaller: tuple[int, int]) -> None:
        self._size = size
        self._smaller = smaller
        self._taken = 0
        self._begun: Image = np.zeros((0, smaller[0], 3), np.float32)

    def add(self, rows: Image) -> Image:
        """Take the next rows (h, W, 3); returns the reduced rows (n, w, 3) that they complete."""
        if self._size == self._smaller:
            return rows
        (_, height), (width, fewer) = self._size, self._smaller
        top, self._taken = self._taken, self._taken + len(rows)
        # in units in which a row is `fewer` high, and a reduced one `height`
        first, complete = top * fewer // height, self._taken * fewer // height
        last = -(-self._taken * fewer // height)
        above = np.arange(first, last)[:, None] * height
        row = np.arange(top, self._taken)[None] * fewer
        shared = np.minimum(above + height, row + fewer) - np.maximum(above, row)
        weights = (np.maximum(shared, 0) / height).astype(np.float32)
        same = np.ascontiguousarray(rows, np.float32)
        narrow = cv2.resize(same, (width, len(rows)), interpolation=cv2.INTER_AREA)
        sums = (weights @ narrow.reshape(len(rows), -1)).reshape(-1, width, 3)
        sums[: len(self._begun)] += self._begun
        self._begun = sums[complete - first :].copy()
        return np.asarray(sums[: complete - first])
