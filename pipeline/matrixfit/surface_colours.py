"""Whether what one lamp does not explain is told by the colours of surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.pair.reduced import ReducedPair

_WIDTH = 0.004  # of red and green chromaticity under the flash, within which colours are one
_DARK = 0.1  # of the median of all light, below which a pixel tells little of its colour
_FEWEST = 4  # pixels of a colour, by which its scatter is told
_SPREAD = 0.1  # of the picture's width and height, by which they lie apart (standard deviation)
_MOSTLY = 0.5  # of the pixels, that must be of such colours


def scatter_within_colours(reduced: ReducedPair, one: Floats64) -> float:
    """Variance, among surfaces of one colour, of what one lamp does not explain; all of it is 1.

    one: (1, 3, 3) matrix of the lamp. No matrix takes the flash part of every surface to its light
    under a lamp, but like surfaces are off alike: of the chromaticities of the light beside those
    that the lamp predicts, what varies within one colour under the flash is the work of another
    lamp, of light that bounces, or of noise. 1 where no more than half of the pixels have others of
    their colour all over the picture: light may be even where a colour is in one place.
    """
    use = reduced.usable
    light, flash = (x[use].astype(np.float64) for x in (reduced.no_flash, reduced.flash))
    predicted = flash @ one[0].T
    totals = [x.sum(axis=1) for x in (light, flash, predicted)]
    bright = np.all([total > _DARK * np.median(total) for total in totals], axis=0)
    light, flash, predicted = light[bright], flash[bright], predicted[bright]
    places = (np.argwhere(use) / use.shape)[bright]
    beside = _chromaticities(light) - _chromaticities(predicted)

    cells = np.rint(_chromaticities(flash) / _WIDTH).astype(np.int64)
    _, cell, counts = np.unique(
        cells[:, 0] * 2**32 + cells[:, 1], return_inverse=True, return_counts=True
    )
    apart = np.square(places - _means(places, cell)[cell])
    wide = np.sqrt(_means(apart, cell)).min(axis=1) >= _SPREAD
    many = (wide & (counts >= _FEWEST))[cell]
    if many.sum() <= _MOSTLY * len(many):
        return 1.0
    weights = np.square(light.sum(axis=1))[many]  # chromaticities of dark pixels are mostly noise
    within = weights @ np.square(beside - _means(beside, cell)[cell])[many].sum(axis=1)
    return float(min(1.0, within / max(weights @ np.square(beside[many]).sum(axis=1), 1e-12)))


def _means(values: Floats64, cell: NDArray[np.int64]) -> Floats64:
    """Means (m, k) of values (n, k) by cell (n,), 0 to m − 1."""
    counts = np.bincount(cell)
    return np.stack([np.bincount(cell, column) / counts for column in values.T], axis=1)


def _chromaticities(colours: Floats64) -> Floats64:
    """Red and green (n, 2) of colours (n, 3), of their sum."""
    return np.asarray(colours[:, :2] / colours.sum(axis=1, keepdims=True))
