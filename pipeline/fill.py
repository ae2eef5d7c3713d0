"""What fills pixels that cannot be separated: the proportions of the light around them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.lamps import Lamps
from pipeline.proportions import model_proportions
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


def push_pull(values: Array, weight: Array) -> Array:
    """Fill gaps from ever wider surroundings (Gortler et al., "The Lumigraph", 1996).

    Parameters
    ----------
    values : (h, w, C)
    weight : (h, w) 0…1, how much of a pixel is known

    Returns
    -------
    (h, w, C): values where the weight is 1, a blend with the surroundings elsewhere
    """
    height, width = weight.shape
    if weight.min() >= 1.0:
        return values
    if max(height, width) == 1:
        return values
    size = ((width + 1) // 2, (height + 1) // 2)
    coarse_weight = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    coarse = [
        cv2.resize(values[..., c] * weight, size, interpolation=cv2.INTER_AREA)
        / np.maximum(coarse_weight, 1e-6)
        for c in range(values.shape[2])
    ]
    # a block that is known in part is known as well as need be
    filled = push_pull(np.stack(coarse, axis=-1), np.minimum(4 * coarse_weight, 1.0))
    wide = [
        cv2.resize(
            np.ascontiguousarray(filled[..., c]), (width, height), interpolation=cv2.INTER_LINEAR
        )
        for c in range(values.shape[2])
    ]
    w = weight[..., None]
    return np.asarray(w * values + (1.0 - w) * np.stack(wide, axis=-1), dtype=np.float32)
