"""The fit: from evidence to the matrices of two lamps."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from pipeline.hui2018.lamps import unit
from pipeline.matrixfit.evidence import gather_evidence
from pipeline.matrixfit.objective import Term, Whitened, make_terms, posterior
from pipeline.matrixfit.prior import MatrixPrior
from pipeline.matrixfit.starts import start_points
from pipeline.reduced import ReducedPair

Array = NDArray[np.float64]

_FEWEST_PIXELS = 200
_FEW_DIFFERENCES = 0.01  # of the usable pixels
_SCORING_DATA = 600
_FIRST, _SECOND, _LAST = 0.02, 0.016, (0.008, 0.004, 0.002)
_KEPT_FIRST, _KEPT_SECOND = 6, 3
_ALIKE = float(np.cos(np.radians(2.5)))
_ROUNDS, _STEPS = 3, 25


def fit_matrices(
    reduced: ReducedPair, flash_only: bool, tensor: Array, prior: MatrixPrior
) -> Array | None:
    """Fit the matrices (2, 3, 3) of two lamps, of unit Frobenius norm; deterministic.

    tensor: (3, 3, 3) D of the model, which the starts are read from. None where there are too few
    pixels to go by.
    """
    evidence = gather_evidence(reduced, flash_only)
    if len(evidence.pixels) < _FEWEST_PIXELS:
        return None
    hull = evidence.difference_share < _FEW_DIFFERENCES
    terms = make_terms(evidence.pixels, evidence.differences, hull)
    weights = [term.weights for term in terms]
    first = [
        _refined(theta, weights, terms, prior, _FIRST, inside_only=True)
        for theta in _best_starts(start_points(evidence, tensor), terms, tensor, prior)
    ]
    first.sort(key=lambda one: one[0])
    second = [_refined(theta, w, terms, prior, _SECOND) for _, theta, w in first[:_KEPT_SECOND]]
    if not second:
        return None
    _, theta, weights = min(second, key=lambda one: one[0])
    for level in _LAST:
        _, theta, weights = _refined(theta, weights, terms, prior, level)
    return prior.matrices(theta / np.linalg.norm(theta, axis=1, keepdims=True))


def _best_starts(
    candidates: Array, terms: list[Term], tensor: Array, prior: MatrixPrior
) -> list[Array]:
    """The few pairs of lamps (2, 9) that explain a sample of the data best."""
    theta = prior.coordinates(np.einsum("klj,nj->nkl", tensor, candidates))
    share = _SCORING_DATA // len(terms)
    thin = [Whitened(replace(term, data=term.data.thinned(share)), _FIRST) for term in terms]
    weights = [term.weights for term in terms]
    pairs = [theta[list(pair)] for pair in combinations(range(len(theta)), 2)]
    scores = [posterior(pair, prior, thin, weights)[0] for pair in pairs]
    kept: list[Array] = []
    for i in np.argsort(scores, kind="stable"):
        # pairs of nearly the same lamps lead to the same optimum
        if all(_unlike(_whites(pairs[i], prior), _whites(other, prior)) for other in kept):
            kept.append(pairs[i])
        if len(kept) == _KEPT_FIRST:
            break
    return kept


def _whites(theta: Array, prior: MatrixPrior) -> Array:
    return unit(prior.matrices(theta).sum(axis=2))


def _unlike(one: Array, other: Array) -> bool:
    """Whether some lamp of one set is far from every lamp of the other."""
    return bool((one @ other.T).max(axis=1).min() < _ALIKE)


def _refined(
    theta: Array,
    weights: list[Array],
    terms: list[Term],
    prior: MatrixPrior,
    s0: float,
    inside_only: bool = False,
) -> tuple[float, Array, list[Array]]:
    """Alternate EM on the weights and L-BFGS on the matrices at one annealing level.

    inside_only: move only within the model's three-dimensional space.
    """
    whitened = [Whitened(term, s0) for term in terms]
    free = slice(0, 3) if inside_only else slice(0, 9)
    shape = theta[:, free].shape
    value = np.inf
    for _ in range(_ROUNDS):
        matrices = prior.matrices(theta)
        weights = [w.reweighted(matrices, old) for w, old in zip(whitened, weights, strict=True)]

        def objective(
            flat: Array, theta: Array = theta, weights: list[Array] = weights
        ) -> tuple[float, Array]:
            moved = theta.copy()
            moved[:, free] = flat.reshape(shape)
            result, gradient = posterior(moved, prior, whitened, weights)
            return result, gradient[:, free].ravel()

        solved = minimize(
            objective,
            theta[:, free].ravel(),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": _STEPS},
        )
        theta = theta.copy()
        theta[:, free] = solved.x.reshape(shape)
        value = float(solved.fun)
    return value, theta, weights
