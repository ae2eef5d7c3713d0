"""How many lamps a pair needs: by how much better one more explains it.

A second lamp counts where the likelihood gains enough by it, but not

- in photographs that a camera rendered: where two lamps leave much light over, and hardly less than
  one does, and three no less, for then it is the rendering's curve that they explain;
- in others: where surfaces of one colour are all off alike under one lamp, which is what no matrix
  can give of them; or where the gain is small and one lamp with gloss explains as much.

A third lamp counts where three signs together speak for it: the gain in likelihood, differences
across shadow edges that two lamps do not give, alone or in exchange, and light that is no mixture
of two. But not where three lamps leave more of the light over than two do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.light.model import Model
from pipeline.matrixfit.contrasts import MANY
from pipeline.matrixfit.evidence import Evidence
from pipeline.matrixfit.fit import MOST_LAMPS, Fit, FitInput
from pipeline.matrixfit.fourth_lamp import any_is_another_again, gain_of_fourth
from pipeline.matrixfit.gloss import is_gloss
from pipeline.matrixfit.surface_colours import scatter_within_colours
from pipeline.matrixfit.unexplained import left_over, share_beside, share_of_third, unexplained
from pipeline.pair.reduced import ReducedPair

MUCH_LEFT = 0.08
"""Relative light left over by lamps that do not explain a photograph; bounced and shiny light
leave up to 0.05."""

DOUBTFUL = 0.5
"""Confidence in a number of lamps that do not explain the photograph, or of which signs differ."""

UNSURE = 0.3
"""Confidence in three lamps where there are signs of a fourth."""

# Chosen on development scenes, exact, noisy and JPEGs (docs/trials/number_of_lamps.md and
# docs/trials/compression_noise.md)
_SECOND_LAMP, _SECOND_LAMP_RENDERED = 300.0, 600.0
_SURELY_SECOND = 1500.0  # gloss gains less
_WITHIN_COLOURS = 0.04  # of what one lamp leaves over, that surfaces of one colour do not share
_LIKELY_ONE = 0.8  # confidence in one lamp, where colours or gloss explain as much as a second
_STILL_LEFT = 0.62  # by several lamps, of what one leaves
_THIRD_GAIN, _THIRD_OFF, _THIRD_RENDERED, _OUTLINE_GAIN = 150.0, 0.125, 1.6, 3.7
_BESIDE, _BESIDE_LEAST, _BESIDE_USUAL = 1.3, 0.01, 0.1  # weight, and shares of the light
_SECOND_STEEPNESS, _THIRD_STEEPNESS = 4.0, 0.75
_FOURTH_UNEXPLAINED, _FOURTH_GAIN = 1.45, 45.0


@dataclass(frozen=True)
class Count:
    """How many lamps there are.

    number: 1 to 3. confidence: 0…1 that it is right.
    """

    number: int
    confidence: float


def count_lamps(given: FitInput, fit: Callable[[int], Fit]) -> Count:
    """Count the lamps of a pair.

    fit: gives the fit of so many lamps, 1 to 3, that one search comes to (first_fit): those that
    fit_matrices comes to for three take several times as long, and change no number. There are as
    many as are pinned, and one, at least. Numbers whose fit has a forbidden lamp are passed over;
    where all of them are, it is the least, for the caller to refuse.
    """
    reduced, evidence = given.reduced, given.evidence
    least = max(1, len(given.known.pinned))
    can_be = (number for number in range(least, MOST_LAMPS + 1) if fit(number).cost < np.inf)
    least = next(can_be, least)
    if fit(least).cost == np.inf:  # what is forbidden leaves no number, which the caller tells
        return Count(least, 1.0)
    several = three = 1.0
    if least < 2:
        gain = max(fit(1).cost - fit(2).cost, 1.0)
        enough = _SECOND_LAMP_RENDERED if reduced.rendered else _SECOND_LAMP
        several = _logistic(_SECOND_STEEPNESS * np.log(gain / enough))
        if gain < enough:
            return Count(1, 1.0 - several)
        if reduced.rendered and _as_much_left(reduced, fit):
            return Count(1, DOUBTFUL)
        if not reduced.rendered and _passes_for_second(reduced, given.model, gain, fit):
            return Count(1, _LIKELY_ONE)
    if least < 3:
        third = _left_by_two(reduced, evidence, fit(2).matrices)
        third += _gain_of_third(reduced, evidence, fit(2), fit(3))
        three = _logistic(_THIRD_STEEPNESS * third)
        if third < 0:
            return Count(2, min(several, 1.0 - three))
        if _leave_more(reduced, fit(2), fit(3)):
            return Count(2, min(several, DOUBTFUL))
    return Count(3, min(several, three))


def signs_of_fourth(given: FitInput, matrices: Floats64) -> bool:
    """Whether three lamps (3, 3, 3) leave more unexplained than three real ones do.

    Not where one of them is another one again, as where three are asked for and there are two: who
    does not need a third lamp needs no fourth.
    """
    evidence = given.evidence
    if not evidence.has_edges or any_is_another_again(given.model, matrices):
        return False
    if unexplained(given.reduced, evidence, matrices) > _FOURTH_UNEXPLAINED:
        return True
    return gain_of_fourth(evidence, given.model, matrices) > _FOURTH_GAIN


def _left_by_two(reduced: ReducedPair, evidence: Evidence, matrices: Floats64) -> float:
    """How far what two lamps (2, 3, 3) do not explain speaks for a third, below 0 against it."""
    off = 0.0
    if evidence.has_edges:
        differences = evidence.differences
        sure = min(len(differences) / MANY, 1.0)
        off = sure * share_of_third(differences, matrices) / _THIRD_OFF
    if reduced.rendered:  # whose curve takes light out of the plane of two lamps
        return off - _THIRD_RENDERED
    beside = share_beside(reduced, matrices) + _BESIDE_LEAST
    return float(off + _BESIDE * np.log(beside / _BESIDE_USUAL))


def _gain_of_third(reduced: ReducedPair, evidence: Evidence, two: Fit, three: Fit) -> float:
    """How far the likelihood speaks for a third lamp, below 0 against it."""
    gain = (two.cost - three.cost) / _THIRD_GAIN
    # lamps of an outline lose by the area between three of them, also if there are three
    return gain if evidence.has_edges or reduced.rendered else gain + _OUTLINE_GAIN


def _leave_more(reduced: ReducedPair, two: Fit, three: Fit) -> bool:
    """Whether three lamps leave more light over than two, so that none of them is a third."""
    return left_over(reduced, three.matrices) > left_over(reduced, two.matrices)


def _passes_for_second(
    reduced: ReducedPair, model: Model, gain: float, fit: Callable[[int], Fit]
) -> bool:
    """Whether colours of surfaces, or gloss, gain as much under one lamp as a second one does."""
    one, two = fit(1).matrices, fit(2).matrices
    if scatter_within_colours(reduced, one) < _WITHIN_COLOURS:
        return True
    return gain < _SURELY_SECOND and is_gloss(reduced, one, two, model.flash_white)


def _as_much_left(reduced: ReducedPair, fit: Callable[[int], Fit]) -> bool:
    """Whether two lamps explain little more than one, and a rendering's curve speaks for them.

    Not where three explain much more: what a curve bends is no mixture of three lamps either.
    """
    much = max(MUCH_LEFT, _STILL_LEFT * left_over(reduced, fit(1).matrices))
    return all(left_over(reduced, fit(number).matrices) > much for number in (2, MOST_LAMPS))


def _logistic(x: float) -> float:
    return float(0.5 + 0.5 * np.tanh(0.5 * x))  # which does not overflow
