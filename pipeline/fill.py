"""What fills pixels that cannot be separated: the proportions of the light around them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

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

    def rows(self, rows: slice, width: int) -> Array:
        """Proportions (N, h, width, 3) for some rows of the full-size picture, bilinear."""
        y, x = (
            (np.arange(start, stop, dtype=np.float32) + 0.5) / self._block - 0.5
            for start, stop in ((rows.start, rows.stop), (0, width))
        )
        xs, ys = np.meshgrid(x, y)
        planes = [
            cv2.remap(plane, xs, ys, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for plane in np.ascontiguousarray(self._map.transpose(2, 0, 1))
        ]
        proportions = np.stack(planes, axis=-1).reshape(len(y), width, self._count, 3)
        return np.asarray(proportions.transpose(2, 0, 1, 3), dtype=np.float32)
