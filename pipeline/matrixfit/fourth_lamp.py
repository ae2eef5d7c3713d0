"""Signs of a fourth lamp: shadow edges and pools of light in a colour that no three lamps give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.arrays import Floats64
from pipeline.light.model import Model
from pipeline.matrixfit.chromaticities import Chromaticities, nothing
from pipeline.matrixfit.evidence import Evidence
from pipeline.matrixfit.objective import Whitened, difference_term
from pipeline.matrixfit.pools import without_coves
from pipeline.matrixfit.starts import start_points
from pipeline.vectors import angles_deg, unit

_LEVEL = 0.004
_DATA = 1600
_OWN_DEGREES = 3.4  # from a lamp, in colour: twice the scatter of its colour over reflectances


def gain_of_fourth(evidence: Evidence, model: Model, matrices: Floats64) -> float:
    """How much log likelihood one more light adds to three lamps (3, 3, 3), 0 or more.

    The gain is told by differences across edges of shadows and, where there are any, by pools of
    light: their mean. For each kind the light is whichever of the fit's starting points gains most.
    Those within 3.4° of one of the three lamps are left out: they would be this lamp again, on
    surfaces whose colour its matrix misses.
    """
    if not len(evidence.differences):
        return 0.0
    pools = without_coves(evidence.pools, matrices)
    kinds = [evidence.differences] + [pools] * (len(pools) > 0)
    alone = [replace(evidence, differences=kind, pools=nothing()) for kind in kinds]
    return float(np.mean([_gain(one, model, matrices) for one in alone]))


def any_is_another_again(model: Model, matrices: Floats64) -> bool:
    """Whether one of some lamps (n, 3, 3) lies within 3.4° in colour of another of them."""
    return any(
        _degrees_off(matrices[index : index + 1], model, matrices[:index])[0] < _OWN_DEGREES
        for index in range(1, len(matrices))
    )


def _gain(evidence: Evidence, model: Model, matrices: Floats64) -> float:
    """As gain_of_fourth, told by evidence.differences alone."""
    lights = model.lamp_matrix(start_points(evidence, model.tensor))
    more = model.prior.matrices(model.prior.coordinates(lights))
    more = more[_degrees_off(more, model, matrices) >= _OWN_DEGREES]
    with_it = [np.concatenate([matrices, one[None]]) for one in more]
    usual, *costs = [_cost(evidence.differences, lamps) for lamps in (matrices, *with_it)]
    return max([0.0, *(usual - cost for cost in costs)])


def _degrees_off(lights: Floats64, model: Model, matrices: Floats64) -> Floats64:
    """Angles (k,) between the colours of lights (k, 3, 3) and those of the nearest lamps."""
    colours, lamps = (unit(one @ model.flash_white) for one in (lights, matrices))
    cosines = np.abs(colours @ lamps.T)  # chromaticities do not tell T from −T
    return angles_deg(cosines.max(axis=1))


def _cost(differences: Chromaticities, matrices: Floats64) -> float:
    """−log likelihood of differences, or of pools."""
    term = difference_term(differences, len(matrices))
    whitened = Whitened(replace(term, data=term.data.thinned(_DATA)), _LEVEL)
    weights = whitened.reweighted(matrices, term.weights)
    return whitened.value(matrices, whitened.reweighted(matrices, weights))[0]
