"""A fourth light at the edges of shadows, which three lamps do not give."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.matrixfit.evidence import Evidence
from pipeline.matrixfit.objective import Whitened, difference_term
from pipeline.matrixfit.starts import start_points
from pipeline.model import Model

Array = NDArray[np.float64]

_LEVEL = 0.004
_DATA = 1600


@dataclass(frozen=True)
class Fourth:
    """What differences across edges of shadows say of a fourth lamp.

    gain: of log likelihood by one more light. least_shown: share of the differences, 0…1, that
    show the one of the three lamps that fewest show; with four lamps, three fitted ones lie
    between them, where no edge shows one.
    """

    gain: float
    least_shown: float


def look_for_fourth(evidence: Evidence, model: Model, matrices: Array) -> Fourth:
    """Compare three lamps (3, 3, 3) with those and one more, each start of the fit in turn."""
    if not len(evidence.differences):
        return Fourth(0.0, 1.0)
    three, shown = _explained(evidence, matrices)
    lights = model.prior.coordinates(model.lamp_matrix(start_points(evidence, model.tensor)))
    costs = [
        _explained(evidence, np.concatenate([matrices, one[None]]))[0]
        for one in model.prior.matrices(lights)
    ]
    return Fourth(max(three - min(costs), 0.0), float(shown[:3].min()))


def _explained(evidence: Evidence, matrices: Array) -> tuple[float, Array]:
    """−log likelihood of the differences, and the shares (K,) of the mixture's components."""
    term = difference_term(evidence.differences, len(matrices))
    whitened = Whitened(replace(term, data=term.data.thinned(_DATA)), _LEVEL)
    weights = whitened.reweighted(matrices, term.weights)
    value, _, counts = whitened.value(matrices, whitened.reweighted(matrices, weights))
    return value, counts / counts.sum()
