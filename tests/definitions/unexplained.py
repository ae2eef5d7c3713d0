"""What lamps leave of each pixel, in plain NumPy, for pipeline.matrixfit.unexplained."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.pair.reduced import ReducedPair, variance_left
from tests.definitions.pixels import shares


def left_of_pixels(reduced: ReducedPair, matrices: Floats64) -> tuple[Floats32, ...]:
    """Of the usable pixels (n,): light left unexplained, all light, its variance, of what is left.

    matrices: (N, 3, 3). What is left is the light less the flash part by the mixture of the lamps.
    """
    no_flash, flash, variance, flash_variance, covariance = (
        image[reduced.usable]
        for image in (
            reduced.no_flash,
            reduced.flash,
            reduced.no_flash_variance,
            reduced.flash_variance,
            reduced.covariance,
        )
    )
    weights = 1.0 / no_flash.mean(axis=0)
    predicted = np.maximum(np.einsum("jkl,nl->jnk", matrices, flash), 0.0)
    share = shares(no_flash * weights, predicted * weights)
    left = np.abs(no_flash - np.einsum("jn,jnk->nk", share, predicted)).sum(axis=1)
    mixed = np.einsum("jn,jkl->nkl", share, matrices)
    of_left = variance_left(mixed, variance, flash_variance, covariance)
    return left, no_flash.sum(axis=1), variance.sum(axis=1), of_left.sum(axis=1)
