"""The fit: from evidence to the matrices of N lamps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, combinations_with_replacement

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from pipeline.matrixfit.evidence import Evidence
from pipeline.matrixfit.objective import Term, Whitened, make_terms, posterior
from pipeline.matrixfit.prior import MatrixPrior
from pipeline.matrixfit.starts import start_points
from pipeline.matrixfit.unexplained import unexplained
from pipeline.reduced import ReducedPair
from pipeline.vectors import unit

Array = NDArray[np.float64]

_FEW_DIFFERENCES = 0.01  # of the usable pixels
_SCORING_DATA = 300
_SCORING_LEVEL = 0.01
_PURE_SHARE, _OTHER_PURE_SHARES = 0.02, (0.03, 0.01)
_LITTLE = 0.6  # unexplained by three lamps
_STARTS = 12
_FIRST_DATA, _FIRST_KEPT = 800, 5
_LEVELS = ((0.008, 2), (0.004, 2), (0.002, 1))
"""Annealing: level s0, and how many of the best go on."""
_COST_LEVEL = 0.004
_ALIKE = float(np.cos(np.radians(2.5)))
_ROUNDS, _STEPS = 3, 25


@dataclass(frozen=True)
class Fit:
    """Fitted lamps.

    matrices: (N, 3, 3), unit Frobenius norm. cost: −log likelihood at one fixed level, lower is
    better; costs of different numbers of lamps on the same evidence can be compared.
    """

    matrices: Array
    cost: float


def fit_matrices(
    reduced: ReducedPair, evidence: Evidence, tensor: Array, prior: MatrixPrior, lamps: int
) -> Fit:
    """Fit the matrices of one to three lamps; deterministic.

    tensor: (3, 3, 3) D of the model, which the starts are read from. How many pixels one lamp
    lights alone decides where corners come to lie, so three lamps that leave much unexplained are
    fitted with other shares of such pixels, and those that leave least are taken.
    """
    first = _fit(evidence, tensor, prior, lamps, _PURE_SHARE)
    if lamps < 3 or (left := unexplained(reduced, evidence, first.matrices)) < _LITTLE:
        return first
    found = [(left, first)]
    for share in _OTHER_PURE_SHARES:
        other = _fit(evidence, tensor, prior, lamps, share)
        found.append((unexplained(reduced, evidence, other.matrices), other))
    return min(found, key=lambda one: one[0])[1]


def _fit(
    evidence: Evidence, tensor: Array, prior: MatrixPrior, lamps: int, pure_share: float
) -> Fit:
    hull = evidence.difference_share < _FEW_DIFFERENCES
    terms = make_terms(evidence.pixels, evidence.differences, lamps, hull, pure_share)
    weights = [term.weights for term in terms]
    level = _LEVELS[0][0]
    thin = [replace(term, data=term.data.thinned(_FIRST_DATA)) for term in terms]
    candidates = [
        _refined(theta, weights, thin, prior, level, inside_only=True)
        for theta in _best_starts(evidence, terms, tensor, prior, lamps)
    ]
    candidates = sorted(candidates, key=lambda one: one[0])[:_FIRST_KEPT]
    for level, kept in _LEVELS:
        candidates = [_refined(theta, w, terms, prior, level) for _, theta, w in candidates]
        candidates = sorted(candidates, key=lambda one: one[0])[:kept]
    _, theta, weights = candidates[0]
    matrices = prior.matrices(theta / np.linalg.norm(theta, axis=1, keepdims=True))
    return Fit(matrices, _cost(matrices, terms))


def _cost(matrices: Array, terms: list[Term]) -> float:
    total = 0.0
    for term in terms:
        if len(term.data):
            whitened = Whitened(term, _COST_LEVEL)
            total += whitened.value(matrices, whitened.reweighted(matrices, term.weights))[0]
    return total


def _best_starts(
    evidence: Evidence, terms: list[Term], tensor: Array, prior: MatrixPrior, lamps: int
) -> list[Array]:
    """The few sets of lamps (N, 9) that explain a sample of the data best."""
    candidates = start_points(evidence, tensor)
    # where a pair shows fewer colours than lamps are asked for, some lamps start alike
    choose = combinations if len(candidates) >= lamps else combinations_with_replacement
    sets = list(choose(range(len(candidates)), lamps))
    theta = prior.coordinates(np.einsum("klj,nj->nkl", tensor, candidates))
    matrices = prior.matrices(theta)
    share = _SCORING_DATA // len(terms)
    thin = [
        Whitened(replace(term, data=term.data.thinned(share)), _SCORING_LEVEL) for term in terms
    ]
    scores = np.zeros(len(sets))
    for term in thin:
        if len(term.term.data):
            scores += [term.value(matrices[list(one)], term.term.weights)[0] for one in sets]
    kept: list[Array] = []
    for i in np.argsort(scores, kind="stable"):
        chosen = list(sets[i])
        one = unit(matrices[chosen].sum(axis=2))
        # sets of nearly the same lamps lead to the same optimum
        if all(_unlike(one, unit(prior.matrices(other).sum(axis=2))) for other in kept):
            kept.append(theta[chosen])
        if len(kept) == _STARTS:
            break
    return kept


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
