"""What fills pixels that cannot be separated: the proportions of the light around."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32
from pipeline.images.enlarge import enlarge
from pipeline.images.frames import by_planes, channels_first
from pipeline.images.push_pull import push_pull
from pipeline.lamps.lamps import Lamps
from pipeline.pair.reduced import ReducedPair
from pipeline.separation.proportions import model_proportions


class Surroundings:
    """Proportions of every lamp in the surroundings of each pixel, smooth, defined everywhere."""

    def __init__(self, reduced: ReducedPair, lamps: Lamps) -> None:
        proportions = model_proportions(reduced.no_flash, reduced.flash, lamps)
        count, height, width = proportions.shape[:3]
        planes = np.moveaxis(proportions, 0, 2).reshape(height, width, count * 3)
        self._map = push_pull(planes, reduced.usable.astype(np.float32))
        self._block = reduced.block
        self._count = count

    def blocks(self) -> Floats32:
        """Proportions (N, h, w, 3) in the middle of every block of the reduced pair."""
        height, width = self._map.shape[:2]
        return np.moveaxis(self._map.reshape(height, width, self._count, 3), 2, 0)

    def rows(self, rows: slice, width: int) -> Floats32:
        """Proportions (N, h, width, 3) for some rows of the full-size picture, bilinear."""
        height = rows.stop - rows.start
        around = by_planes(self._count, height, width, 3)
        planes = channels_first(around).reshape(-1, height, width)
        enlarge(self._map, self._block, rows, planes)
        return around
