"""A fourth light at the edges of shadows and in pools of light, which three lamps do not give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.lamps.model import Model
from pipeline.matrixfit.data import Data, nothing
from pipeline.matrixfit.evidence import Evidence
from pipeline.matrixfit.objective import Whitened, difference_term
from pipeline.matrixfit.pools import without_coves
from pipeline.matrixfit.starts import start_points

Array = NDArray[np.float64]

_LEVEL = 0.004
_DATA = 1600


def gain_of_fourth(evidence: Evidence, model: Model, matrices: Array) -> float:
    """How much log likelihood one more light adds to three lamps (3, 3, 3), 0 or more.

    It is that of the differences across edges of shadows, and where there are pools, the mean of
    theirs and that of the pools. The light is the best of the fit's own starts, for each.
    """
    if not len(evidence.differences):
        return 0.0
    pools = without_coves(evidence.pools, matrices)
    kinds = [evidence.differences] + [pools] * (len(pools) > 0)
    alone = [replace(evidence, differences=kind, pools=nothing()) for kind in kinds]
    return float(np.mean([_gain(one, model, matrices) for one in alone]))


def _gain(evidence: Evidence, model: Model, matrices: Array) -> float:
    """As gain_of_fourth, of the differences alone."""
    lights = model.lamp_matrix(start_points(evidence, model.tensor))
    more = model.prior.matrices(model.prior.coordinates(lights))
    costs = [_cost(evidence.differences, np.concatenate([matrices, one[None]])) for one in more]
    return max(_cost(evidence.differences, matrices) - min(costs), 0.0)


def _cost(differences: Data, matrices: Array) -> float:
    """−log likelihood of differences, or of pools."""
    term = difference_term(differences, len(matrices))
    whitened = Whitened(replace(term, data=term.data.thinned(_DATA)), _LEVEL)
    weights = whitened.reweighted(matrices, term.weights)
    return whitened.value(matrices, whitened.reweighted(matrices, weights))[0]
