"""Photographs in a smaller size, each pixel the mean of the area that it covers."""

from __future__ import annotations

import math

import cv2
import numpy as np

from pipeline.images.area_strips import AreaStrips
from pipeline.images.coded_image import CodedImage
from pipeline.images.frames import Image, Photograph
from pipeline.images.strips import strips

_ROWS = 48  # of the photograph, made linear at a time
_SUMMED_ROWS = 16  # the same where parts of them are summed: they stay in the processor's cache
_MANY_ROWS = 512  # above which parts of them are summed


def size_within(size: tuple[int, int], longest: int) -> tuple[int, int]:
    """(width, height) of the same shape as size, no side longer than that, and no larger."""
    scale = min(1.0, longest / max(size))
    return max(round(size[0] * scale), 1), max(round(size[1] * scale), 1)


def area_means(
    photograph: Photograph, size: tuple[int, int], crop: tuple[int, int] | None = None
) -> Image:
    """Reduce a photograph (H, W, 3) to (width, height): float32 (height, width, 3).

    crop: (width, height) of the upper left part that is reduced; all of it where None.
    """
    columns, rows = crop or (photograph.shape[1], photograph.shape[0])
    if not isinstance(photograph, CodedImage):
        return _resized(photograph[:rows, :columns], size)
    groups = math.gcd(rows, size[1])  # of rows that become whole rows
    of, to = rows // groups, size[1] // groups
    if of > _MANY_ROWS:
        summed = AreaStrips((columns, rows), size)
        parts = (photograph[some, :columns] for some in strips(rows, _SUMMED_ROWS))
        return np.concatenate([summed.add(part) for part in parts])
    small = np.empty((size[1], size[0], 3), np.float32)
    step = -(-_ROWS // of)
    for first in range(0, groups, step):
        last = min(first + step, groups)
        part = photograph[first * of : last * of, :columns]
        small[first * to : last * to] = _resized(part, (size[0], (last - first) * to))
    return small


def _resized(image: Image, size: tuple[int, int]) -> Image:
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)
