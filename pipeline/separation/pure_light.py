"""Which lamps are never seen alone, so that only the outline of the mixtures tells their colour."""

from __future__ import annotations

import numpy as np

from pipeline.lamps.lamps import Lamps
from pipeline.pair.reduced import ReducedPair
from pipeline.separation.proportions import model_proportions

# Chosen on development scenes (docs/trials/warnings.md)
_OUTERMOST = 0.995  # quantile: where a lamp shines alone, found a little off as it may be
_ALONE, _NEARLY = (0.01, 0.02, 0.03), 0.05  # below it; alone is between two of them
_GATHERED = 0.45  # of the pixels nearly of one lamp are of it alone where it shines alone
_LEAST_AREA = 0.015  # share of the usable pixels
_LEAST_PLACES = 0.001  # the same, see Lamps.alone


def without_pure_light(reduced: ReducedPair, lamps: Lamps) -> list[int]:
    """Indices of lamps that neither light an area alone nor cast a shadow that shows it.

    The shadow may be a surface's own, where it turns away from the lamp.

    Lamps are fitted to the outline of the light, so that some pixels always lie at each of them.
    Where a lamp shines alone, a whole area does; at the outline of mixtures there is but a rim.
    """
    if len(lamps) == 1:
        return []
    parts = model_proportions(reduced.no_flash, reduced.flash, lamps)[:, reduced.usable]
    shares = (parts * reduced.no_flash[reduced.usable]).sum(axis=2)
    shares /= np.maximum(shares.sum(axis=0), 1e-12)
    most = np.quantile(shares, _OUTERMOST, axis=1, keepdims=True)
    nearly, *beyond = (np.mean(shares > most - below, axis=1) for below in (_NEARLY, *_ALONE))
    # stray pixels reach further than the area does that a lamp, found a little off, lights alone
    alone = np.diff(beyond, axis=0, prepend=0.0).max(axis=0)
    area = (alone > _LEAST_AREA) & (alone > _GATHERED * nearly)
    return [int(index) for index in np.flatnonzero(~area & (lamps.alone < _LEAST_PLACES))]
