"""A spectrum from few numbers, by what measured spectra of its kind are like.

The prior is a mixture: about each measured spectrum a Gaussian of smooth deviations from it. All
is linear, so that for each member the likeliest spectrum and the evidence have a closed form
(Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006, equations 2.23 to 2.30).
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.spectra.wavelengths import WAVELENGTHS_NM


def smooth(reach_nm: float) -> Floats64:
    """Correlation (W, W) of deviations that keep to a value over so many nanometres."""
    distance = WAVELENGTHS_NM[:, None] - WAVELENGTHS_NM
    return np.asarray(np.exp(-0.5 * np.square(distance / reach_nm)))


def posterior(
    matrix: Floats64, seen: Floats64, variance: Floats64, mean: Floats64, covariance: Floats64
) -> tuple[Floats64, float]:
    """Mean (W,) of a Gaussian spectrum after seeing some numbers, and the log evidence of it.

    The evidence is but for −n/2 · log 2π, the same for all members of a mixture.

    seen = matrix · spectrum, matrix (n, W), with the variance (n,); before that the spectrum has
    the mean (W,) and the covariance (W, W).
    """
    spread = covariance @ matrix.T
    total = matrix @ spread + np.diag(variance)
    surprise = seen - matrix @ mean
    pull = np.linalg.solve(total, surprise)
    evidence = -0.5 * (surprise @ pull + np.linalg.slogdet(total)[1])
    return mean + spread @ pull, float(evidence)


def best_scale(predicted: Floats64, seen: Floats64, variance: Floats64) -> float:
    """Factor by which a prediction (n,) fits best, at least a tiny one."""
    scale = (predicted * seen / variance).sum() / (np.square(predicted) / variance).sum()
    return max(float(scale), 1e-12)


def weights(evidence: list[float]) -> Floats64:
    """Probabilities (n,), together 1, of the members of a mixture from their log evidence."""
    relative = np.exp(np.array(evidence) - max(evidence))
    return np.asarray(relative / relative.sum())
