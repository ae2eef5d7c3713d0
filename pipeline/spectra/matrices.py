"""The best 3×3 matrix between two ways of seeing surfaces."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Matrix
from pipeline.spectra.colorimetry import white_preserving
from pipeline.spectra.lights import reflectance_spectra


def best_matrix(before: Floats64, after: Floats64) -> Matrix:
    """Matrix (3, 3) from camera RGB seen by one response to that by another, over reflectances.

    before, after: (3, W), sensitivities × the spectrum of a light. Least squares; errors count
    relative to brightness, so that dark surfaces matter as much as light ones.
    """
    rho = reflectance_spectra()
    seen = rho @ before.T
    weight = _weight(seen)
    return np.asarray(np.linalg.lstsq(seen * weight, rho @ after.T * weight, rcond=None)[0].T)


def balancing_matrix(before: Floats64, after: Floats64) -> Matrix:
    """As best_matrix, (3, 3) too, but a white card becomes exactly white: greys keep no cast.

    Raises numpy.linalg.LinAlgError where `before` does not tell three colours apart.
    """
    rho = reflectance_spectra()
    seen = rho @ before.T
    weight = _weight(seen)
    whites = before.sum(axis=1), after.sum(axis=1)
    return white_preserving(seen * weight, rho @ after.T * weight, *whites)


def by_spectrum(sensitivities: Floats64, before: Floats64) -> Floats64:
    """Tensor G (3, 3, W) with best_matrix(before, sensitivities × l) = G @ l for any light l.

    sensitivities, before: (3, W).
    """
    rho = reflectance_spectra()
    seen = rho @ before.T
    weight = _weight(seen)
    solve = np.linalg.pinv(seen * weight) * weight.T
    return np.asarray(np.einsum("lw,kw->klw", solve @ rho, sensitivities))


def _weight(seen: Floats64) -> Floats64:
    return np.asarray(1.0 / np.abs(seen).sum(1, keepdims=True))
