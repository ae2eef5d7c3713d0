"""Posterior of the lamps' matrices given the evidence, with its gradient."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.matrixfit.evidence import Data
from pipeline.matrixfit.mixture import Shape, log_densities
from pipeline.matrixfit.prior import MatrixPrior

Array = NDArray[np.float64]

_EM_ROUNDS = 5
_OUTLIERS = (0.005, 0.03)
_MIN_TOTAL = 0.02  # of the sum of a lamp's light of unit norm: beyond, chromaticity runs away


@dataclass(frozen=True)
class Term:
    """One kind of data with its mixture.

    weights: (4,) of the components at the start. pseudo_count: of the Dirichlet prior that keeps
    them near. fixed: never re-estimated. bounded: the share of outliers stays within limits.
    """

    data: Data
    shape: Shape
    weights: Array
    pseudo_count: float
    fixed: bool = False
    bounded: bool = False


class Whitened:
    """A term at one annealing level s0: data made isotropic by their own covariance."""

    def __init__(self, term: Term, s0: float) -> None:
        self.term = term
        floor = (term.shape.spread * s0) ** 2
        a, b, c = (term.data.covariance + np.array([floor, 0.0, floor])).T
        root = np.sqrt(np.maximum(a * c - b * b, 1e-24))
        self.sigma = np.sqrt(root)
        scale = self.sigma / (root * np.sqrt(a + c + 2 * root))
        # σ A^(−½), which keeps areas
        self.whitener = np.stack([c + root, -b, -b, a + root], axis=1).reshape(-1, 2, 2)
        self.whitener *= scale[:, None, None]
        self.u = np.einsum("nij,nj->ni", self.whitener, term.data.u)

    def corners(self, matrices: Array) -> tuple[Array, Array, Array]:
        """Whitened corners (2, n, 2), plain ones (2, n, 2) and the sums Σ T x (2, n)."""
        light = np.einsum("jkl,nl->jnk", matrices, self.term.data.x)
        total = light.sum(axis=2)
        total = np.where(np.abs(total) < _MIN_TOTAL, np.copysign(_MIN_TOTAL, total), total)
        plain = light[..., :2] / total[..., None]
        return np.einsum("nij,knj->kni", self.whitener, plain), plain, total

    def value(self, matrices: Array, weights: Array) -> tuple[float, Array]:
        """−Σ weight · log density, and its gradient in the matrices (2, 3, 3)."""
        corners, plain, total = self.corners(matrices)
        densities, gradients = log_densities(self.u, corners, self.sigma, self.term.shape)
        parts = densities * weights[:, None]
        mixed = np.maximum(parts.sum(axis=0), 1e-300)
        worth = self.term.data.weight
        by_corner = np.zeros_like(corners)
        for part, gradient in zip(parts, gradients, strict=True):
            for lamp, direction in gradient.items():
                by_corner[lamp] += (part / mixed)[:, None] * direction
        by_plain = np.einsum("nij,kni->knj", self.whitener, by_corner) * worth[:, None]
        # ∂v_i/∂T_kl = x_l (δ_ik − v_i) / Σ T x
        by_light = np.zeros((len(matrices), len(worth), 3))
        by_light[..., :2] = by_plain
        by_light -= (by_plain * plain).sum(axis=2, keepdims=True)
        by_matrix = np.einsum("jnk,nl->jkl", by_light / total[..., None], self.term.data.x)
        return float(-(worth * np.log(mixed)).sum()), -by_matrix

    def reweighted(self, matrices: Array, weights: Array) -> Array:
        """Weights of the components after some rounds of EM with the matrices held."""
        if self.term.fixed or not len(self.term.data):
            return weights
        corners, _, _ = self.corners(matrices)
        densities, _ = log_densities(self.u, corners, self.sigma, self.term.shape)
        prior = self.term.pseudo_count * self.term.weights
        for _ in range(_EM_ROUNDS):
            parts = densities * weights[:, None]
            responsible = parts / np.maximum(parts.sum(axis=0), 1e-300)
            counts = (responsible * self.term.data.weight).sum(axis=1) + prior
            weights = counts / counts.sum()
            if self.term.bounded:
                outliers = float(np.clip(weights[-1], *_OUTLIERS))
                weights[:-1] *= (1 - outliers) / weights[:-1].sum()
                weights[-1] = outliers
        return weights


def posterior(
    theta: Array, prior: MatrixPrior, terms: list[Whitened], weights: list[Array]
) -> tuple[float, Array]:
    """Objective and gradient at θ (2, 9)."""
    matrices = prior.matrices(theta)
    value, gradient = prior.penalty(theta)
    for term, weight in zip(terms, weights, strict=True):
        if len(term.term.data):
            more, by_matrix = term.value(matrices, weight)
            value += more
            gradient = gradient + by_matrix.reshape(-1, 9) @ prior.basis
    return value, gradient


def make_terms(pixels: Data, differences: Data, hull: bool) -> list[Term]:
    """The mixtures of two lamps.

    hull: there are no shadow edges, so that only the ends of the pixels' line speak.
    """
    inside = Shape(extension=0.0, outlier=1.5, spread=1.0)
    if hull:
        return [Term(pixels, inside, np.array([0.003, 0.003, 0.974, 0.02]), 0.0, fixed=True)]
    across = Shape(extension=0.5, outlier=6.0, spread=1.5)
    return [
        Term(pixels, inside, np.array([0.15, 0.15, 0.67, 0.03]), 200.0, bounded=True),
        Term(differences, across, np.array([0.2, 0.2, 0.4, 0.2]), 25.0),
    ]
