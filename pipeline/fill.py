"""What fills pixels that cannot be separated: the proportions of the light around."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.compiling import exact
from pipeline.frames import by_planes, channels_first
from pipeline.lamps import Lamps
from pipeline.proportions import model_proportions
from pipeline.push_pull import push_pull
from pipeline.reduced import ReducedPair

Array = NDArray[np.float32]


class Surroundings:
    """Proportions of every lamp in the surroundings of each pixel, smooth, defined everywhere."""

    def __init__(self, reduced: ReducedPair, lamps: Lamps) -> None:
        proportions = model_proportions(reduced.no_flash, reduced.flash, lamps)
        count, height, width = proportions.shape[:3]
        planes = np.moveaxis(proportions, 0, 2).reshape(height, width, count * 3)
        self._map = push_pull(planes, reduced.usable.astype(np.float32))
        self._block = reduced.block
        self._count = count

    def blocks(self) -> Array:
        """Proportions (N, h, w, 3) in the middle of every block of the reduced pair."""
        height, width = self._map.shape[:2]
        return np.moveaxis(self._map.reshape(height, width, self._count, 3), 2, 0)

    def rows(self, rows: slice, width: int) -> Array:
        """Proportions (N, h, width, 3) for some rows of the full-size picture, bilinear."""
        around = by_planes(self._count, rows.stop - rows.start, width, 3)
        x, right = self._between(0, width, self._map.shape[1])
        y, lower = self._between(rows.start, rows.stop, self._map.shape[0])
        _enlarge(self._map, x, right, y, lower, channels_first(around))
        return around

    def _between(self, start: int, stop: int, blocks: int) -> tuple[NDArray[np.int64], Array]:
        """First of the two blocks beside each pixel start…stop of an axis, the second's weight."""
        place = (np.arange(start, stop) + 0.5) / self._block - 0.5
        first = np.clip(np.floor(place), 0, max(blocks - 2, 0))
        return first.astype(np.int64), np.clip(place - first, 0.0, 1.0).astype(np.float32)


@exact
def _enlarge(
    blocks: Array,
    x: NDArray[np.int64],
    right: Array,
    y: NDArray[np.int64],
    lower: Array,
    around: Array,
) -> None:
    """Write blocks (h, w, 3N) between which pixels lie into (N, 3, H, W)."""
    one = np.float32(1.0)
    height, width, planes = blocks.shape
    row = np.empty(width, np.float32)
    for i in range(len(y)):
        for p in range(planes):
            top, bottom = blocks[y[i], :, p], blocks[min(y[i] + 1, height - 1), :, p]
            for c in range(width):
                row[c] = (one - lower[i]) * top[c] + lower[i] * bottom[c]
            written = around[p // 3, p % 3, i]
            for j in range(len(x)):
                second = row[min(x[j] + 1, width - 1)]
                written[j] = (one - right[j]) * row[x[j]] + right[j] * second
