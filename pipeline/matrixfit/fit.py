"""The fit: from evidence to the matrices of N lamps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Floats64
from pipeline.errors import UnusablePairError
from pipeline.hui2018.lights import lights_of_pair
from pipeline.light.model import Model
from pipeline.matrixfit.chromaticities import Chromaticities
from pipeline.matrixfit.evidence import Evidence
from pipeline.matrixfit.known import Known, Pin, nothing_known
from pipeline.matrixfit.objective import (
    Term,
    Whitened,
    alone_term,
    make_terms,
    most_mirrored,
    without_mirrors,
)
from pipeline.matrixfit.pools import without_coves
from pipeline.matrixfit.search import LEVELS, Problem, follow, search
from pipeline.matrixfit.starts import invariants, start_points
from pipeline.matrixfit.unexplained import left_over, mean_left_over, unexplained
from pipeline.pair.reduced import ReducedPair
from pipeline.vectors import unit

MOST_LAMPS = 3
"""As many as three colour channels tell apart."""

_PURE_SHARES = {1: (1.0,), 2: (0.15,), 3: (0.02, 0.03, 0.01)}
"""Share of pixels that each of so many lamps lights alone: the usual one, and others."""

_FEWER_PURE = {2: (0.05, 0.02), 3: (0.01, 0.005, 0.002)}
"""Shares to which lamps are followed, one after the other."""

_LESS = {2: (0.93, 0.98), 3: (0.95,)}
"""Of what the usual lamps leave (_left): wider apart, lamps always leave a little less."""

_LITTLE = 0.6  # unexplained
_NOTHING = 1e-6  # of the light
_AGAINST = 0.2  # of the weight of terminators and pools: so much likelier are lamps they speak for
_CLEARLY = 3.0  # of −log posterior; the same lamps found twice differ by less
_MOST_MIRRORED = 0.35  # of the differences: no lamp is mirrored so much more than it shines
_OUTLINE_LEVELS = (*LEVELS, (0.001, 1))
_OUTLINE_WIDENED = 3**0.5  # with one kind of data instead of two, the prior would weigh too much
_COST_LEVEL, _RENDERED_COST_LEVEL = 0.004, 0.008  # a camera's rendering bends chromaticities


@dataclass(frozen=True)
class FitInput:
    """What lamps are fitted to.

    evidence: gathered from the reduced pair. model: of its camera and flash. known: what is given
    of the lamps.
    """

    reduced: ReducedPair
    evidence: Evidence
    model: Model
    known: Known

    @property
    def surest(self) -> FitInput:
        """The same with the surest evidence alone (Evidence.surest)."""
        return replace(self, evidence=self.evidence.surest)

    def without_coves(self, matrices: Floats64) -> FitInput:
        """Without the pools that three lamps (3, 3, 3), as found, tell from those of one."""
        if len(matrices) < MOST_LAMPS:
            return self
        pools = without_coves(self.evidence.pools, matrices)
        return replace(self, evidence=replace(self.evidence, pools=pools))


@dataclass(frozen=True)
class Fit:
    """Fitted lamps.

    matrices: (N, 3, 3), unit Frobenius norm, pinned lamps first. cost: −log likelihood, at a fixed
    annealing level, of the likeliest lamps that were found; the matrices may be others, which leave
    less unexplained or were followed on. Lower is better; costs of different numbers of lamps on
    the same evidence can be compared. It is infinite where no fit avoids what is forbidden.
    passed_over: (N, 3, 3) each, what else the search came to.
    """

    matrices: Floats64
    cost: float
    passed_over: tuple[Floats64, ...] = ()


def fit_pin(data: Chromaticities, model: Model, of_area: bool) -> Pin:
    """Pin the lamp that shows these data alone: the likeliest matrix, however few colours."""
    term = alone_term(data)
    start = model.lamp_matrix(unit(invariants(data, model.tensor).sum(axis=0)))
    problem = Problem(1, [term], model.prior, LEVELS, nothing_known(model.flash_white))
    matrices, _ = follow(problem, [start[None]])
    return Pin(term, matrices[0], of_area)


def first_fit(given: FitInput, lamps: int) -> Fit:
    """Fit the matrices of one to three lamps by one search; deterministic. Else as fit_matrices.

    Where shadows have no edges, lamps are told by the outline of the cloud of pixels, by
    terminators and by pools of light. If the published lamps leave no light over there, that
    outline is exact and they are taken as they are, unless terminators and pools say that it does
    not reach as far as the lamps.

    Several lamps are followed from the published ones, too, and the likelier end is taken: where
    nearly all light is mixed, or lamps are strongly coloured, the search from its own starts may
    miss the likeliest two; three are treated alike, since costs of different numbers of lamps are
    compared. Of a photograph that a camera rendered the search's own end is taken.
    """
    given, reduced, outline = given.surest, given.reduced, not given.evidence.has_edges
    problem = _problem(given, lamps, outline, _PURE_SHARES[lamps][0])
    level = _cost_level(reduced)
    # of chromaticities that a camera's rendering bent, the likeliest lamps are too often wrong
    searched_too = lamps == MOST_LAMPS or (lamps > 1 and not reduced.rendered)
    published = _published(given, lamps) if outline or searched_too else None
    exact, bends = None, (given.evidence.terminators, given.evidence.pools)
    if outline and published is not None and _leaves_nothing(given, published):
        exact = Fit(published, _cost(published, problem.terms, level))
        if not any(map(len, bends)):
            return exact
    candidates, also = _candidates(given), published if searched_too else None
    matrices, *passed_over = _likeliest(problem, candidates, also, not reduced.rendered)
    if not reduced.rendered and _is_mirror(problem, matrices, level):
        # as light bounced off a wall can make it
        problem = replace(problem, terms=[without_mirrors(one) for one in problem.terms])
        matrices, *passed_over = _likeliest(problem, candidates, also, not reduced.rendered)
    cost = np.inf if given.known.rejects(matrices) else _cost(matrices, problem.terms, level)
    weight = sum(bend.weight.sum() for bend in bends)
    if exact is not None and cost > exact.cost - _AGAINST * weight:
        return exact
    return Fit(matrices, cost, tuple(passed_over))


def _likeliest(
    problem: Problem, candidates: Floats64, published: Floats64 | None, may_win: bool
) -> list[Floats64]:
    """What the search comes to, and what it comes to from the published lamps, if there are any.

    The likelier comes first where published lamps may win.
    """
    matrices, cost = search(problem, candidates)
    if published is None:
        return [matrices]
    other, other_cost = follow(problem, [problem.known.completed(published)])
    return [other, matrices] if may_win and other_cost < cost else [matrices, other]


def fit_matrices(given: FitInput, lamps: int, first: Fit | None = None) -> Fit:
    """Fit the matrices of one to three lamps, beside those that are pinned; deterministic.

    first: of first_fit, where it is there. How many pixels one lamp lights alone decides where
    corners come to lie. So three lamps that leave much unexplained are found in other ways, too;
    those that leave least are taken.
    """
    first = first or first_fit(given, lamps)
    if lamps < MOST_LAMPS or not _leave_much(given, first.matrices):
        return first
    return _least_unexplained(given.surest, first)


def fit_pools(given: FitInput, usual: Fit) -> Fit:
    """Move several lamps of fit_matrices by pools of light, where shadows have edges, too.

    They are followed from where they are, so that what edges told is not lost. Where they leave
    much, those that a search with pools comes to are taken if they are clearly likelier. The cost
    stays: lamps are counted by what is surest.
    """
    lamps, evidence = len(usual.matrices), given.evidence
    if lamps == 1 or not (evidence.has_edges and len(evidence.pools)) or usual.cost == np.inf:
        return usual
    given = given.without_coves(usual.matrices)
    problem = _problem(given, lamps, False, _PURE_SHARES[lamps][0])
    matrices, cost = follow(problem, [usual.matrices])
    if _leave_much(given, matrices):
        others, other_cost = search(problem, _candidates(given))
        matrices = others if other_cost < cost - _CLEARLY else matrices
    level = _cost_level(given.reduced)
    if given.known.rejects(matrices) or _is_mirror(problem, matrices, level):
        return usual
    return replace(usual, matrices=matrices)


def follow_outwards(given: FitInput, usual: Fit) -> Fit:
    """Follow lamps on while ever fewer pixels are taken for pure, lit by one lamp alone.

    Before a wall hardly a pixel is pure, and the usual share of pure ones draws the lamps' corners
    inwards, to where each is brightest on the wall. So two lamps of fit_matrices, or three that
    leave much, are followed, and taken where they leave clearly less. The cost stays, since costs
    of different numbers of lamps are of one share of pure pixels. Lamps of a photograph that a
    camera rendered stay: it bends chromaticities, which leaves over more than is to be told.
    """
    lamps, reduced = len(usual.matrices), given.reduced
    if lamps == 1 or not given.evidence.has_edges or reduced.rendered or usual.cost == np.inf:
        return usual
    given = given.without_coves(usual.matrices)
    usual_left = _left(given, usual.matrices)
    if lamps == MOST_LAMPS and usual_left[0] <= _LITTLE:
        return usual
    matrices = best = usual.matrices
    least = limits = np.array(_LESS[lamps]) * usual_left
    for share in _FEWER_PURE[lamps]:
        problem = _problem(given, lamps, False, share)
        matrices, _ = follow(problem, [matrices])
        if given.known.rejects(matrices) or _is_mirror(problem, matrices, _cost_level(reduced)):
            break
        left = _left(given, matrices)
        # noise may hide all that either leaves where most is left
        if (left <= limits).all() and left[0] < least[0]:
            best, least = matrices, left
    return replace(usual, matrices=best)


def _is_mirror(problem: Problem, matrices: Floats64, level: float) -> bool:
    """Whether a mirrored lamp explains so many differences that it has taken a lamp's place."""
    return max(most_mirrored(one, matrices, level) for one in problem.terms) > _MOST_MIRRORED


def _leave_much(given: FitInput, matrices: Floats64) -> bool:
    """Whether lamps leave much unexplained."""
    # the few differences of an outline are chance, and tell nothing of what is left
    if not given.evidence.has_edges:
        return False
    return unexplained(given.reduced, given.evidence, matrices) > _LITTLE


def _least_unexplained(given: FitInput, first: Fit) -> Fit:
    """Three lamps as they are found in every way, those that leave least."""
    reduced, evidence, known = given.reduced, given.evidence, given.known
    terms = _problem(given, MOST_LAMPS, False, _PURE_SHARES[MOST_LAMPS][0]).terms
    found = [first.matrices, *first.passed_over, *_otherwise(given)]
    found = [one for one in found if not known.rejects(one)] or found[:1]
    cost = min(_cost(one, terms, _cost_level(reduced)) for one in found)
    matrices = min(found, key=lambda one: unexplained(reduced, evidence, one))
    return Fit(matrices, np.inf if known.rejects(matrices) else cost)


def _leaves_nothing(given: FitInput, matrices: Floats64) -> bool:
    """Whether lamps, of which none is known, leave no light over."""
    if given.known.pinned or given.known.rejects(matrices):
        return False
    return mean_left_over(given.reduced, matrices) < _NOTHING


def _candidates(given: FitInput) -> Floats64:
    """Matrices (k, 3, 3) that may be lamps."""
    return given.model.lamp_matrix(start_points(given.evidence, given.model.tensor))


def _cost_level(reduced: ReducedPair) -> float:
    return _RENDERED_COST_LEVEL if reduced.rendered else _COST_LEVEL


def _otherwise(given: FitInput) -> Iterator[Floats64]:
    """Three lamps (3, 3, 3) by the outline, and by other shares of pure pixels."""
    candidates = _candidates(given)
    usual, *others = _PURE_SHARES[MOST_LAMPS]
    for outline, share in ((True, usual), *((False, one) for one in others)):
        yield search(_problem(given, MOST_LAMPS, outline, share), candidates)[0]


def _left(given: FitInput, matrices: Floats64) -> Floats64:
    """What two or three lamps leave.

    Of two the light in all, and where most is left; of three, whose light explains nearly any, all
    signs.
    """
    reduced = given.reduced
    if len(matrices) == MOST_LAMPS:
        return np.array([unexplained(reduced, given.evidence, matrices)])
    return np.array([mean_left_over(reduced, matrices), left_over(reduced, matrices)])


def _published(given: FitInput, lamps: int) -> Floats64 | None:
    """Matrices (N, 3, 3) of unit norm of the lamps that the published method finds, if any."""
    model = given.model
    try:
        matrices = model.lamp_matrix(lights_of_pair(given.reduced, model, lamps))
    except UnusablePairError:  # hardly any pixels agree
        return None
    return np.asarray(matrices / np.linalg.norm(matrices, axis=(1, 2), keepdims=True))


def _problem(given: FitInput, lamps: int, outline: bool, pure_share: float) -> Problem:
    evidence, prior, known = given.evidence, given.model.prior, given.known
    terms = make_terms(evidence, lamps, outline, pure_share, known.flash_white)
    if not outline:
        return Problem(lamps, terms, prior, LEVELS, known)
    wide = replace(prior, deviations=_OUTLINE_WIDENED * prior.deviations)
    return Problem(lamps, terms, wide, _OUTLINE_LEVELS, known)


def _cost(matrices: Floats64, terms: list[Term], level: float) -> float:
    total = 0.0
    for term in terms:
        if len(term.data):
            whitened = Whitened(term, level)
            total += whitened.value(matrices, whitened.reweighted(matrices, term.weights))[0]
    return total
