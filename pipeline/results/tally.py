"""What share of a separation was filled in from the surroundings, counted strip by strip."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.compiling import summing
from pipeline.images.frames import Plane, Planes, planes_of

_FILLED = 0.5  # confidence below which a pixel counts as filled in


class Tally:
    """Counts the strips of a picture of height × width pixels, with the light of so many lamps."""

    def __init__(self, lamps: int, height: int, width: int) -> None:
        self._pixels = height * width
        self._filled = 0
        # of each row, so that the strips do not matter
        self._light, self._sure = np.zeros((2, lamps, height))

    def add(self, rows: slice, layers: Floats32, confidence: Plane) -> None:
        """Count some rows: layers (N, h, W, 3), confidence (h, W) 0…1."""
        self._filled += int(np.count_nonzero(confidence < _FILLED))
        for lamp, layer in enumerate(layers):
            _sum_rows(planes_of(layer), confidence, self._light[lamp, rows], self._sure[lamp, rows])

    @property
    def filled(self) -> float:
        """Share of the pixels that are filled in, 0…1."""
        return self._filled / self._pixels

    @property
    def separated(self) -> Floats64:
        """(N,) part 0…1 of each lamp's light that was separated: Σ confidence · layer ÷ Σ layer."""
        return np.asarray(self._sure.sum(axis=1) / np.maximum(self._light.sum(axis=1), 1e-12))


@summing
def _sum_rows(layer: Planes, confidence: Plane, light: Floats64, sure: Floats64) -> None:
    """In any order of the additions, as compilers need it for vector instructions."""
    zero = np.float32(0.0)
    for y in range(len(light)):
        total, certain = 0.0, 0.0
        for x in range(confidence.shape[1]):
            red, green, blue = layer[0][y, x], layer[1][y, x], layer[2][y, x]
            one = np.float64(max(red, zero) + max(green, zero) + max(blue, zero))
            total += one
            certain += one * confidence[y, x]
        light[y], sure[y] = total, certain
