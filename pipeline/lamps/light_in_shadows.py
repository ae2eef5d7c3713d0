"""How much of a lamp's light is left in its own shadows: what came by way of other surfaces."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.lamps.lamps import Lamps
from pipeline.light.shares import shares
from pipeline.matrixfit.differences import shadow_edges
from pipeline.matrixfit.evidence import readable_light
from pipeline.pair.reduced import ReducedPair

_OFF = 0.03  # chromaticity between a difference and the lamp that it shows
_FEWEST = 100  # edges of a lamp's shadows that tell anything
_DEEPEST = 0.25  # of them: others end in the shadow's rim, which the lamp partly lights


def light_in_shadows(reduced: ReducedPair, lamps: Lamps) -> Floats64:
    """Light of each lamp in its shadows ÷ beside them, (N,), 0 and more.

    Across the edge of a shadow a lamp's direct light goes, and its difference shows the lamp's
    colour. What else it gives to the dark side has met another surface before. Of the edges whose
    difference shows a lamp it is the lowest quarter; 0 of a lamp whose shadows have few edges.
    """
    ratios = readable_light(reduced)
    weights = lamps.channel_weights
    left: list[list[Floats64]] = [[] for _ in lamps.matrices]
    for at in shadow_edges(ratios):
        light, colour = ratios.light[at], ratios.colour[at]
        gives = np.maximum(np.einsum("jkl,nel->jnek", lamps.matrices, colour), 0.0)
        parts = shares((light * weights).astype(np.float32), (gives * weights).astype(np.float32))
        lit, dark = np.moveaxis(parts, 2, 0)
        difference = light[:, 0] - light[:, 1]
        alone = gives.mean(axis=2)
        off = np.linalg.norm(
            difference / difference.sum(axis=1, keepdims=True)
            - alone / np.maximum(alone.sum(axis=2, keepdims=True), 1e-12),
            axis=2,
        )
        shown = np.where(off.min(axis=0) < _OFF, off.argmin(axis=0), -1)
        for lamp, found in enumerate(left):
            here = (shown == lamp) & (lit[lamp] > 0)
            found.append(dark[lamp, here] / lit[lamp, here])
    every = [np.concatenate([np.zeros(0), *found]) for found in left]
    return np.array([np.quantile(one, _DEEPEST) if len(one) >= _FEWEST else 0.0 for one in every])
