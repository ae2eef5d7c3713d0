"""What fills pixels that cannot be separated: the proportions of the light around."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.images.enlarge import enlarge
from pipeline.images.frames import Image, by_planes, channels_first
from pipeline.images.push_pull import push_pull
from pipeline.lamps.lamps import Lamps
from pipeline.pair.reduced import ReducedPair
from pipeline.separation.fill_alike import fill_alike
from pipeline.separation.proportions import model_proportions

_UNKNOWN = 1 / 12  # variance of a proportion of which nothing is known: any from 0 to 1 alike
_TINY = 1e-30


class Surroundings:
    """Proportions of every lamp in the surroundings of each pixel, smooth, defined everywhere.

    The noisier a block, the less it counts beside those around. Gaps whose light without the flash
    is known, as in the flash's shadows, are as places around with light like it.
    """

    def __init__(self, reduced: ReducedPair, lamps: Lamps) -> None:
        proportions = model_proportions(reduced.no_flash, reduced.flash, lamps)
        count, height, width = proportions.shape[:3]
        planes = np.ascontiguousarray(np.moveaxis(proportions, 0, 2).reshape(height, width, -1))
        known = _known(reduced, lamps.least_sine)
        self._map = fill_alike(
            push_pull(planes, known), planes, known, reduced.no_flash, reduced.no_flash_variance
        )
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


def _known(reduced: ReducedPair, least_sine: float) -> Floats32:
    """How much is known of the blocks' proportions, (h, w): 0 in unusable ones, else ½…1.

    The weight of a block beside one of which nothing is known, each by its variance. What noise is
    of the light, by the sine of the least angle between two lamps, is how far it moves proportions.
    """
    noise = _relative(reduced.no_flash, reduced.no_flash_variance)
    noise += _relative(reduced.flash, reduced.flash_variance)
    variance = np.minimum(noise / least_sine**2, _UNKNOWN)
    return np.where(reduced.usable, _UNKNOWN / (_UNKNOWN + variance), 0.0).astype(np.float32)


def _relative(light: Image, variance: Image) -> Floats64:
    """Variance (h, w) of the sum of a block's channels, relative to its square."""
    squared = np.square(light.sum(axis=2, dtype=np.float64))
    return np.asarray(variance.sum(axis=2, dtype=np.float64) / np.maximum(squared, _TINY))
