"""Posterior of the lamps' matrices given the evidence, with its gradient."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.arrays import Floats64
from pipeline.light.prior import MatrixPrior
from pipeline.matrixfit.chromaticities import Chromaticities
from pipeline.matrixfit.evidence import Evidence
from pipeline.matrixfit.mixture import blocks, mixture

# Chosen on development scenes (docs/decisions/0005-fitted-lamps.md)
_EM_ROUNDS = 3
_PSEUDO_COUNT = 25.0
_COVES = 0.15  # of pools, at first
_MIRRORED = 0.15  # of the differences, at first; where nothing is glossy the rounds take it away


@dataclass(frozen=True)
class Shape:
    """Which mixture it is.

    interior: whether the inside of three lamps' triangle is a component, as it is of pixels and
    not of differences. extension: how far edges reach beyond their ends, in lengths. outlier:
    density of outliers. spread: factor on the annealing level s0. area_power: exponent of the
    interior's density in its area.
    """

    interior: bool
    extension: float
    outlier: float
    spread: float
    area_power: float = 0.5


@dataclass(frozen=True)
class Term:
    """One kind of data with its mixture.

    weights: (K,) of the components at the start: corners, edges, mirrors, for three lamps the
    interior, outliers. pseudo_count: of the Dirichlet prior that keeps them near, None where they
    stay as they are. mirrored: (3,) chromaticity of the flash on what mirrors light, zeros where
    nothing is expected to.
    """

    data: Chromaticities
    shape: Shape
    weights: Floats64
    pseudo_count: float | None
    mirrored: Floats64 = field(default_factory=lambda: np.zeros(3))


_PIXELS = Shape(interior=True, extension=0.0, outlier=1.5, spread=1.0)
_OUTLINE = replace(_PIXELS, area_power=0.2)
_ALONE = replace(_PIXELS, interior=False)
_DIFFERENCES = Shape(interior=False, extension=0.5, outlier=6.0, spread=1.5)
_TERMINATORS = replace(_DIFFERENCES, extension=0.0)


class Whitened:
    """A term at one annealing level s0: data made isotropic by their own covariance."""

    def __init__(self, term: Term, s0: float) -> None:
        self.term = term
        floor = (term.shape.spread * s0) ** 2
        a, b, c = (term.data.covariance + np.array([floor, 0.0, floor])).T
        root = np.sqrt(np.maximum(a * c - b * b, 1e-24))
        sigma = np.sqrt(root)
        scale = sigma / (root * np.sqrt(a + c + 2 * root))
        # σ A^(−½), which keeps areas
        whitener = np.stack([c + root, -b, -b, a + root], axis=1) * scale[:, None]
        whitener = whitener.reshape(-1, 2, 2)
        u = np.einsum("nij,nj->ni", whitener, term.data.u)
        self._blocks = blocks(
            term.data.x, u, whitener, sigma, term.data.weight, term.shape.area_power
        )

    def value(self, matrices: Floats64, weights: Floats64) -> tuple[float, Floats64, Floats64]:
        """−Σ weight · log density, its gradient in the matrices (N, 3, 3), counts (K,)."""
        shape = self.term.shape
        found: tuple[float, Floats64, Floats64] = mixture(
            np.ascontiguousarray(matrices),
            self._blocks,
            weights,
            shape.extension,
            shape.outlier,
            shape.area_power,
            shape.interior and len(matrices) == 3,
            self.term.mirrored,
        )
        return found

    def reweighted(self, matrices: Floats64, weights: Floats64) -> Floats64:
        """Weights (K,) of the components after some rounds of EM, the matrices (N, 3, 3) held."""
        if self.term.pseudo_count is None or not len(self.term.data):
            return weights
        for _ in range(_EM_ROUNDS):
            counts = self.value(matrices, weights)[2] + self.term.pseudo_count * self.term.weights
            weights = counts / counts.sum()
        return weights


def posterior(
    theta: Floats64,
    prior: MatrixPrior,
    terms: list[Whitened],
    weights: list[Floats64],
    alone: list[Whitened],
    fence: Callable[[Floats64], tuple[float, Floats64]],
) -> tuple[float, Floats64]:
    """Objective and gradient at θ (N, 9).

    alone: what each of the first lamps shows alone. fence: a penalty of matrices (N, 3, 3) and its
    gradient, where lamps may not be.
    """
    matrices = prior.matrices(theta)
    value, gradient = prior.penalty(theta)
    height, by_matrix = fence(matrices)
    value += height
    for lamp, term in enumerate(alone):
        more, of_lamp, _ = term.value(matrices[lamp : lamp + 1], term.term.weights)
        value += more
        by_matrix[lamp] += of_lamp[0]
    for term, weight in zip(terms, weights, strict=True):
        if len(term.term.data):
            more, of_term, _ = term.value(matrices, weight)
            value += more
            by_matrix += of_term
    return value, gradient + by_matrix.reshape(-1, 9) @ prior.basis


def make_terms(
    evidence: Evidence, lamps: int, outline: bool, pure_share: float, flash_white: Floats64
) -> list[Term]:
    """The mixtures for a number of lamps.

    flash_white: (3,) camera RGB of a white card under the flash.
    pure_share: of several lamps, the share of pixels that each lights alone.
    outline: there are no shadow edges, so that pixels speak by their cloud's outline alone.
    """
    if outline:
        return [
            _outline_term(evidence.pixels, lamps),
            _terminator_term(evidence.terminators, lamps),
            difference_term(evidence.pools, lamps),
        ]
    differences = difference_term(evidence.differences, lamps)
    return [
        _pixel_term(evidence.pixels, lamps, pure_share),
        _with_mirrors(differences, flash_white) if lamps == 2 else differences,
        _pool_term(evidence.pools, lamps),
    ]


def alone_term(data: Chromaticities) -> Term:
    """The mixture of what one lamp shows alone."""
    return Term(data, _ALONE, np.array([0.98, 0.02]), None)


def difference_term(differences: Chromaticities, lamps: int) -> Term:
    """The mixture of differences across edges of shadows, or of pools, for one to four lamps."""
    weights = _dealt({1: (0.8, 0.0), 2: (0.4, 0.4)}.get(lamps, (0.39, 0.3)), lamps)
    weights = np.append(weights, 1.0 - weights.sum())
    return Term(differences, _DIFFERENCES, weights, _PSEUDO_COUNT)


def without_mirrors(term: Term) -> Term:
    """The same mixture, if it has mirrors, without them."""
    if not term.mirrored.any():
        return term
    weights = np.concatenate([term.weights[:-3], term.weights[-1:]])
    return replace(term, weights=weights / weights.sum(), mirrored=np.zeros(3))


def most_mirrored(term: Term, matrices: Floats64, s0: float) -> float:
    """Share of the data that the mirror of one of two lamps (2, 3, 3) explains at a level s0."""
    if not term.mirrored.any():
        return 0.0
    return float(Whitened(term, s0).reweighted(matrices, term.weights)[-3:-1].max())


def _with_mirrors(term: Term, flash_white: Floats64) -> Term:
    """The mixture of differences of two lamps of which some are the borders of highlights.

    Light that a surface mirrors has the lamp's colour and not the surface's (Shafer 1985).
    """
    corners, rest = term.weights[:-1] * (1.0 - _MIRRORED), term.weights[-1:] * (1.0 - _MIRRORED)
    weights = np.concatenate([corners, np.full(2, _MIRRORED / 2), rest])
    return replace(term, weights=weights, mirrored=flash_white / flash_white.sum())


def _pixel_term(pixels: Chromaticities, lamps: int, pure_share: float) -> Term:
    """The mixture of pixels, of which each of several lamps lights a share alone."""
    weights = {
        1: (0.97, 0.03),
        2: (pure_share, pure_share, 0.97 - 2 * pure_share, 0.03),
        3: (pure_share,) * 3 + (1.5 * pure_share,) * 3 + (0.975 - 7.5 * pure_share, 0.025),
    }
    # re-estimated, they give way until a corner sits in a cluster of pixels
    return Term(pixels, _PIXELS, np.array(weights[lamps]), None)


def _outline_term(pixels: Chromaticities, lamps: int) -> Term:
    """The mixture of pixels where edges tell nothing: hardly any is lit by one lamp alone."""
    weights = {
        1: (0.98, 0.02),
        2: (0.003, 0.003, 0.974, 0.02),
        3: (0.003,) * 3 + (0.01,) * 3 + (0.941, 0.02),
    }
    return Term(pixels, _OUTLINE, np.array(weights[lamps]), None)


def _pool_term(pools: Chromaticities, lamps: int) -> Term:
    """The mixture of pools beside edges: of three lamps, some bend all light, as coves do."""
    term = difference_term(pools, lamps)
    if lamps < 3:
        return term
    weights = np.insert(term.weights, -1, _COVES)
    weights[-1] -= _COVES
    return replace(term, shape=replace(term.shape, interior=True), weights=weights)


def _terminator_term(terminators: Chromaticities, lamps: int) -> Term:
    """The mixture of terminators: one lamp's alone, seldom two that lie together."""
    weights = _dealt((0.9, 0.0) if lamps == 1 else (0.85, 0.05), lamps)
    return Term(terminators, _TERMINATORS, np.append(weights, 0.1), _PSEUDO_COUNT)


def _dealt(shares: tuple[float, float], lamps: int) -> Floats64:
    """Weights of corners and edges that have these shares together, each kind evenly."""
    corners, edges = shares
    pairs = lamps * (lamps - 1) // 2
    return np.array([corners / lamps] * lamps + [edges / max(pairs, 1)] * pairs)
