"""Pictures that are kept until it is known how bright they are to be shown."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Image, Matrix, Photograph, by_planes, planes_of
from pipeline.half_floats import to_float, to_half
from pipeline.order import quantile
from pipeline.progress import STRIP_ROWS

_SHOWN_GAIN = (0.25, 8.0)
_SHOWN_WHITE = 0.995  # quantile of a picture's brightest channel that becomes white
_SAMPLE_STEP = 4


class Canvas:
    """A linear picture as half floats, whose rounding is a twentieth of a step of 8 bits.

    size: (width, height). It is given from top to bottom.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        width, height = size
        self._planes = np.empty((3, height, width), np.float16)
        self._next = 0

    def write(self, linear: Image) -> None:
        """Take the next rows (h, W, 3)."""
        rows = slice(self._next, self._next + len(linear))
        for kept, plane in zip(self._planes, planes_of(linear), strict=True):
            kept[rows] = to_half(plane)
        self._next = rows.stop

    def strips(self) -> Iterator[Image]:
        """Rows (h, W, 3), float32, from top to bottom."""
        for top in range(0, self._planes.shape[1], STRIP_ROWS):
            planes = self._planes[:, top : top + STRIP_ROWS]
            strip = by_planes(*planes.shape[1:], 3)
            for channel, plane in enumerate(planes):
                strip[..., channel] = to_float(plane)
            yield strip

    def picture(self) -> Image:
        """Give it whole (H, W, 3), float32."""
        return np.concatenate(list(self.strips()))

    def gain(self, matrix: Matrix) -> float:
        """Return shown_gain of the picture."""
        return shown_gain(np.moveaxis(self._planes, 0, -1), matrix)


def shown_gain(picture: Photograph | NDArray[np.float16], matrix: Matrix) -> float:
    """Factor by which bright parts of a picture (H, W, 3) become white.

    matrix: (3, 3), to the linear RGB of the screen.
    """
    sample = picture[::_SAMPLE_STEP, ::_SAMPLE_STEP].astype(np.float32)
    shown = sample @ matrix.T.astype(np.float32)
    # not .max(axis=2), which takes ten times as long for three channels
    brightest = np.maximum(np.maximum(shown[..., 0], shown[..., 1]), shown[..., 2])
    white = quantile(brightest, _SHOWN_WHITE)
    return float(np.clip(1.0 / max(white, 1e-6), *_SHOWN_GAIN))
