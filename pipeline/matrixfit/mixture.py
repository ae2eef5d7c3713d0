"""Likelihood of chromaticities, given where two lamps put those of each datum's flash colour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

Array = NDArray[np.float64]

_TINY = 1e-300
_SHORT = 0.01  # of σ: lines shorter than this keep a fixed direction


@dataclass(frozen=True)
class Shape:
    """Which mixture it is: two corners, the line between them, and outliers.

    extension: how far the line reaches beyond its ends, in lengths. outlier: density of outliers.
    spread: factor on the annealing level s0.
    """

    extension: float
    outlier: float
    spread: float


def log_densities(
    u: Array, corners: Array, sigma: Array, shape: Shape
) -> tuple[Array, list[dict[int, Array]]]:
    """Density of every component and the gradient of its logarithm.

    Parameters
    ----------
    u : (n, 2) whitened chromaticities
    corners : (2, n, 2) whitened corners
    sigma : (n,) isotropic standard deviations

    Returns
    -------
    densities : (4, n), in the order of the corners, line, outliers
    gradients : for each component, lamp → (n, 2), ∂ log density / ∂ corner
    """
    densities: list[Array] = []
    gradients: list[dict[int, Array]] = []
    for j, corner in enumerate(corners):
        offset = (u - corner) / sigma[:, None]
        densities.append(np.exp(-0.5 * (offset**2).sum(1)) / (2 * np.pi * sigma**2))
        gradients.append({j: offset / sigma[:, None]})
    density, (by_a, by_b) = _line(u, corners[0], corners[1], sigma, shape.extension)
    densities += [density, np.full(len(u), shape.outlier)]
    gradients += [{0: by_a, 1: by_b}, {}]
    return np.stack(densities), gradients


def _line(
    u: Array, a: Array, b: Array, sigma: Array, k: float
) -> tuple[Array, tuple[Array, Array]]:
    """Density of points spread evenly from a to b, k lengths beyond either, and its gradient."""
    span = b - a
    length = np.linalg.norm(span, axis=1)
    short = length < _SHORT * sigma
    e = np.where(short[:, None], (1.0, 0.0), span / np.where(short, 1.0, length)[:, None])
    length = np.maximum(length, _SHORT * sigma)
    m = np.stack([e[:, 1], -e[:, 0]], axis=1)
    from_a = u - a
    t, d = (from_a * e).sum(1), (from_a * m).sum(1)
    low, high = (t + k * length) / sigma, (t - (1 + k) * length) / sigma
    covered = np.maximum(ndtr(low) - ndtr(high), _TINY)
    across = np.exp(-0.5 * (d / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma)
    density = across * covered / ((1 + 2 * k) * length)

    at_low = np.exp(-0.5 * low**2) / np.sqrt(2 * np.pi)
    at_high = np.exp(-0.5 * high**2) / np.sqrt(2 * np.pi)
    dt_b, dt_a = m * (d / length)[:, None], -e - m * (d / length)[:, None]
    dd_b, dd_a = -m * (t / length)[:, None], -m * (1 - t / length)[:, None]

    def gradient(dt: Array, dd: Array, dl: Array) -> Array:
        d_low, d_high = (dt + k * dl) / sigma[:, None], (dt - (1 + k) * dl) / sigma[:, None]
        d_covered = (at_low[:, None] * d_low - at_high[:, None] * d_high) / covered[:, None]
        return np.asarray(d_covered - (d / sigma**2)[:, None] * dd - dl / length[:, None])

    return density, (gradient(dt_a, dd_a, -e), gradient(dt_b, dd_b, e))
