"""Lamps whose matrices are fitted to the pair, from lamps estimated by the published method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.lamps import Lamps
from pipeline.matrixfit.fit import fit_matrices
from pipeline.model import Model
from pipeline.reduced import ReducedPair

_FITTED = 2
"""Number of lamps that are fitted: three collapse onto a line too often."""
_LEAST_ANGLE = np.cos(np.radians(0.5))


def fit_lamps(lamps: Lamps, reduced: ReducedPair, flash_only: bool, model: Model) -> Lamps:
    """Replace the matrices of two lamps by the ones that explain the pair best.

    One lamp and three stay as the published method found them, as do two that the fit brings
    together. flash_only: the flash file was the flash part alone, so that its noise does not hang
    together with that of the other.
    """
    if len(lamps) != _FITTED:
        return lamps
    fit = fit_matrices(reduced, flash_only, model.tensor, model.prior)
    if fit is None:
        return lamps
    whites = fit @ model.flash_white
    # chromaticities do not tell T from −T
    scale = np.sign(whites.sum(axis=1)) * np.linalg.norm(whites, axis=1)
    coefficients = whites / scale[:, None]
    if coefficients[0] @ coefficients[1] > _LEAST_ANGLE:
        return lamps
    order = np.argsort(-coefficients[:, 0] / coefficients.sum(axis=1))
    return replace(
        lamps,
        coefficients=coefficients[order],
        matrices=(fit / scale[:, None, None])[order],
    )
