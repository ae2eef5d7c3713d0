"""Pictures made smaller for a screen."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from pipeline.arrays import Floats32
from pipeline.encode.exr import ExrFile, channels_of
from pipeline.images.area_means import area_means, size_within
from pipeline.images.frames import Image, Photograph

PREVIEW_PIXELS = 2**21
"""Most pixels of a preview."""

_THUMBNAIL = 400  # pixels of the longer side


def preview_step(size: tuple[int, int]) -> int:
    """Side in pixels of the squares of a picture (width, height) that a preview has one pixel of.

    1 where the picture is no larger than a preview may be.
    """
    return max(1, math.ceil(math.sqrt(size[0] * size[1] / PREVIEW_PIXELS)))


class PreviewFile:
    """An EXR of 16-bit floats, the means of squares of preview_step pixels; from top to bottom.

    size: (width, height) of what is given. Pixels at the right and the lower edge that fill no
    square are left out.
    """

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        self._step = preview_step(size)
        self._width = size[0] // self._step
        self._file = ExrFile(path, (self._width, size[1] // self._step), half=True)
        self._rest: dict[str, Floats32] = {}

    def write(self, pictures: dict[str, Floats32]) -> None:
        """Take the next rows, given as to ExrFile."""
        planes = channels_of(pictures)
        height = len(next(iter(planes.values())))
        waiting = len(next(iter(self._rest.values()))) if self._rest else 0
        start = min(-waiting % self._step, height)
        if start:  # they go on with squares that the rows before began
            begun = {
                name: np.concatenate([self._rest[name], plane[:start]])
                for name, plane in planes.items()
            }
            self._rest = {} if waiting + start == self._step else begun
            if not self._rest:
                self._append(begun)
        whole = start + (height - start) // self._step * self._step
        if start < whole:
            self._append({name: plane[start:whole] for name, plane in planes.items()})
        if whole < height:
            self._rest = {name: plane[whole:].copy() for name, plane in planes.items()}

    def close(self) -> None:
        """End the file."""
        self._file.close()

    def _append(self, planes: dict[str, Floats32]) -> None:
        """Write the means of whole squares."""
        self._file.write({name: self._means(plane) for name, plane in planes.items()})

    def _means(self, rows: Floats32) -> Floats32:
        plane = rows[:, : self._width * self._step]
        size = self._width, len(rows) // self._step
        return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.float32)


def thumbnail(picture: Photograph) -> Image:
    """Make a picture (H, W, 3) at most 400 pixels long; a smaller one stays as it is."""
    height, width = picture.shape[:2]
    size = size_within((width, height), _THUMBNAIL)
    if size == (width, height):
        return np.array(picture[:])  # its own memory: a photograph's may be given back
    return area_means(picture, size)
