"""The search for the likeliest matrices: starts compared, the best followed by annealing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, combinations_with_replacement

import numpy as np

from pipeline.arrays import Floats64
from pipeline.light.prior import MatrixPrior
from pipeline.matrixfit.known import Known
from pipeline.matrixfit.minimum import minimum
from pipeline.matrixfit.objective import Term, Whitened, posterior
from pipeline.vectors import unit

LEVELS = ((0.008, 2), (0.004, 2), (0.002, 1))
"""Annealing: level s0, a standard deviation added to that of every chromaticity (times
Shape.spread), and how many of the best go on from there."""

# Chosen on development scenes (docs/decisions/0005-fitted-lamps.md)
_SCORING_DATA, _SCORING_LEAST = 300, 150  # together, and of each kind
_SCORING_LEVEL = 0.01  # s0, as in LEVELS
_STARTS = 12  # sets of lamps that are followed
_FIRST_DATA, _FIRST_KEPT = 800, 5  # data of each kind in the first round; sets that go on from it
_ALIKE = float(np.cos(np.radians(2.5)))  # between lamps of two sets
_ROUNDS, _STEPS = 3, 25  # of EM at each level, and of BFGS in each
_FIRST_STEP = 0.005  # of a lamp's norm
_OF_STARTS, _ON_THE_WAY, _AT_LAST = 1e-4, 1e-5, 1e-6  # precision: what is compared needs less


@dataclass(frozen=True)
class Problem:
    """What is to be fitted, and how.

    lamps: how many, those that known pins first. terms: their mixtures. levels: as in LEVELS.
    """

    lamps: int
    terms: list[Term]
    prior: MatrixPrior
    levels: tuple[tuple[float, int], ...]
    known: Known


def search(problem: Problem, candidates: Floats64) -> tuple[Floats64, float]:
    """Matrices (N, 3, 3) that sets of candidates lead to, and their cost, as follow gives them.

    candidates: (k, 3, 3) matrices that may be lamps.
    """
    terms, level = problem.terms, problem.levels[0][0]
    weights = [term.weights for term in terms]
    thin = [replace(term, data=term.data.thinned(_FIRST_DATA)) for term in terms]
    tried = [
        _refined(theta, weights, replace(problem, terms=thin), level, _OF_STARTS, inside_only=True)
        for theta in _best_starts(problem, candidates)
    ]
    best = sorted(tried, key=lambda one: one[0])[:_FIRST_KEPT]
    return follow(problem, [problem.prior.matrices(theta) for _, theta, _ in best])


def follow(problem: Problem, starts: list[Floats64]) -> tuple[Floats64, float]:
    """Matrices (N, 3, 3) of unit norm, the likeliest that these starts (N, 3, 3) lead to.

    The cost beside them is −log posterior at the last level. They have a forbidden lamp among
    them only where every start leads to one, and then the cost is infinite.
    """
    weights = [term.weights for term in problem.terms]
    found = [(0.0, problem.prior.coordinates(one), weights) for one in starts]
    last, _ = problem.levels[-1]
    for level, kept in problem.levels:
        precision = _AT_LAST if level == last else _ON_THE_WAY
        found = [_refined(t, w, problem, level, precision) for _, t, w in found]
        found = sorted(found, key=lambda one: one[0])[:kept]
    cost, theta, _ = found[0]
    return problem.prior.matrices(theta / np.linalg.norm(theta, axis=1, keepdims=True)), cost


def _best_starts(problem: Problem, candidates: Floats64) -> list[Floats64]:
    """The few sets of lamps (N, 9) that explain a sample of the data best."""
    terms, prior, known = problem.terms, problem.prior, problem.known
    pinned = tuple(range(len(known.pinned)))
    allowed = candidates[~known.forbids(candidates)]
    candidates = np.concatenate([known.matrices, allowed if len(allowed) else candidates])
    free, places = problem.lamps - len(pinned), range(len(pinned), len(candidates))
    # where a pair shows fewer colours than lamps are asked for, some lamps start alike
    choose = combinations if len(places) >= free else combinations_with_replacement
    sets = [(*pinned, *chosen) for chosen in choose(places, free)]
    theta = prior.coordinates(candidates)
    matrices = prior.matrices(theta)
    kinds = sum(len(term.data) > 0 for term in terms)
    share = max(_SCORING_DATA // max(kinds, 1), _SCORING_LEAST)
    thin = [
        Whitened(replace(term, data=term.data.thinned(share)), _SCORING_LEVEL) for term in terms
    ]
    scores = np.zeros(len(sets))
    for term in thin:
        if len(term.term.data):
            scores += [term.value(matrices[list(one)], term.term.weights)[0] for one in sets]
    kept: list[Floats64] = []
    for i in np.argsort(scores, kind="stable"):
        chosen = list(sets[i])
        one = unit(matrices[chosen].sum(axis=2))
        # sets of nearly the same lamps lead to the same optimum
        if all(_unlike(one, unit(prior.matrices(other).sum(axis=2))) for other in kept):
            kept.append(theta[chosen])
        if len(kept) == _STARTS:
            break
    return kept


def _unlike(one: Floats64, other: Floats64) -> bool:
    """Whether some lamp of one set is far from every lamp of the other."""
    return bool((one @ other.T).max(axis=1).min() < _ALIKE)


def _refined(
    theta: Floats64,
    weights: list[Floats64],
    problem: Problem,
    s0: float,
    precision: float,
    inside_only: bool = False,
) -> tuple[float, Floats64, list[Floats64]]:
    """Alternate EM on the weights and BFGS on the matrices at one annealing level.

    precision: as in minimum. inside_only: move only within the model's three-dimensional space. The
    cost that is returned first is infinite where a lamp comes near a forbidden one.
    """
    prior, known = problem.prior, problem.known
    whitened = [Whitened(term, s0) for term in problem.terms]
    alone = [Whitened(pin.term, s0) for pin in known.pinned]
    free = slice(0, 3) if inside_only else slice(0, 9)
    shape = theta[:, free].shape
    value, inverse = np.inf, None
    for _ in range(_ROUNDS):
        matrices = prior.matrices(theta)
        weights = [w.reweighted(matrices, old) for w, old in zip(whitened, weights, strict=True)]

        def objective(
            flat: Floats64, theta: Floats64 = theta, weights: list[Floats64] = weights
        ) -> tuple[float, Floats64]:
            moved = theta.copy()
            moved[:, free] = flat.reshape(shape)
            result, gradient = posterior(moved, prior, whitened, weights, alone, known.fence)
            return result, gradient[:, free].ravel()

        start = theta[:, free].ravel()
        found, inverse = minimum(objective, start, _STEPS, precision, _FIRST_STEP, inverse)
        theta = theta.copy()
        theta[:, free] = found.x.reshape(shape)
        value = found.value
    return np.inf if known.rejects(prior.matrices(theta)) else value, theta, weights
