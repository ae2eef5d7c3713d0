"""What the fit explains: chromaticities, how sure they are, and how much each counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64

_LEAST_COLOUR = 0.02  # dimmer channels of the flash part would tell without bound


@dataclass(frozen=True)
class Chromaticities:
    """n chromaticities to be explained, the data of one kind.

    x: (n, 3) flash colour, summing to 1. u: (n, 2) red and green chromaticity of the light.
    covariance: (n, 3) its xx, xy, yy. weight: (n,).
    """

    x: Floats64
    u: Floats64
    covariance: Floats64
    weight: Floats64

    def __len__(self) -> int:
        return len(self.weight)

    @property
    def light(self) -> Floats64:
        """All three chromaticities of the light (n, 3), summing to 1."""
        return np.concatenate([self.u, 1.0 - self.u.sum(axis=1, keepdims=True)], axis=1)

    @property
    def variance(self) -> Floats64:
        """Variance (n,) of both chromaticities together."""
        return np.asarray(self.covariance[:, 0] + self.covariance[:, 2])

    def corners(self, matrices: Floats64) -> Floats64:
        """Chromaticities (N, n, 2) of lamps (N, 3, 3) on the surface of each datum."""
        light = np.einsum("jkl,nl->jnk", matrices, self.x)
        return np.asarray(light[..., :2] / light.sum(axis=2, keepdims=True))

    def thinned(self, count: int) -> Chromaticities:
        """Evenly drawn subset of at most so many, with the same total weight."""
        if len(self) <= count:
            return self
        pick = np.linspace(0, len(self) - 1, count).round().astype(int)
        scale = self.weight.sum() / self.weight[pick].sum()
        return Chromaticities(
            self.x[pick], self.u[pick], self.covariance[pick], self.weight[pick] * scale
        )


def nothing() -> Chromaticities:
    """No data at all."""
    empty = np.zeros((0, 3))
    return Chromaticities(empty, np.zeros((0, 2)), empty, np.zeros(0))


def draw(worth: Floats64, count: int) -> NDArray[np.int64]:
    """Indices drawn with probability ∝ worth by systematic sampling, so always the same ones."""
    if len(worth) <= count:
        return np.arange(len(worth))
    ladder = np.cumsum(worth)
    rungs = (np.arange(count) + 0.5) / count * ladder[-1]
    return np.unique(np.searchsorted(ladder, rungs))


def by_colour(centring: Floats64, u: Floats64, x: Floats64) -> Floats64:
    """How chromaticities u (n, 3) change with the flash colours x (n, 3) they are seen by.

    centring: (n, 3, 3), I − u 1ᵀ. Of a lamp that multiplies channels, J = (I − u 1ᵀ) diag(u ÷ x).
    """
    return np.asarray(centring * (u / np.maximum(x, _LEAST_COLOUR))[:, None, :])


def sandwich(left: Floats64, variance: Floats64, right: Floats64) -> Floats64:
    """L diag(v) Rᵀ of matrices L, R (n, 3, 3) and variances v (n, 3)."""
    return np.asarray((left * variance[:, None, :]) @ right.transpose(0, 2, 1))


def upper(covariance: Floats64) -> Floats64:
    """Return xx, xy, yy (n, 3) of covariances (n, 3, 3)."""
    return np.stack([covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]], axis=1)
