"""A fourth light at the edges of shadows, which three lamps do not give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.matrixfit.evidence import Evidence
from pipeline.matrixfit.objective import Whitened, difference_term
from pipeline.matrixfit.starts import start_points
from pipeline.model import Model

Array = NDArray[np.float64]

_LEVEL = 0.004
_DATA = 1600


def gain_of_fourth(evidence: Evidence, model: Model, matrices: Array) -> float:
    """How much log likelihood one more light adds to three lamps (3, 3, 3), 0 or more.

    It is that of the differences across edges of shadows, and the light the best of the fit's own
    starts.
    """
    if not len(evidence.differences):
        return 0.0
    lights = model.lamp_matrix(start_points(evidence.surest, model.tensor))
    more = model.prior.matrices(model.prior.coordinates(lights))
    costs = [_cost(evidence, np.concatenate([matrices, one[None]])) for one in more]
    return max(_cost(evidence, matrices) - min(costs), 0.0)


def _cost(evidence: Evidence, matrices: Array) -> float:
    """−log likelihood of the differences."""
    term = difference_term(evidence.differences, len(matrices))
    whitened = Whitened(replace(term, data=term.data.thinned(_DATA)), _LEVEL)
    weights = whitened.reweighted(matrices, term.weights)
    return whitened.value(matrices, whitened.reweighted(matrices, weights))[0]
