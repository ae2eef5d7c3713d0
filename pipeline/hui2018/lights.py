"""The lights of a scene from its invariants, as published and with nothing added.

Source: Hui et al. 2018, supplement, section 1. This is the yardstick of other methods: what would
make it better belongs elsewhere.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.errors import UnusablePairError
from pipeline.hui2018.invariant import light_coefficients
from pipeline.hui2018.pruning import prune
from pipeline.hui2018.three_lights import three_lights
from pipeline.hui2018.two_lights import two_lights
from pipeline.light.model import Model
from pipeline.pair.reduced import ReducedPair
from pipeline.vectors import unit

NO_AGREEMENT = (
    "The light of hardly any pixel agrees with that of another: use a stronger flash and less ISO "
    "speed, or check camera and encoding."
)
"""What is said where invariants show no lights."""

_FEWEST = 3  # invariants: a triangle needs as many


def lights_of_pair(reduced: ReducedPair, model: Model, count: int) -> Floats64:
    """Coefficients (count, 3) of the lights of a pair, unit vectors in the model's coordinates.

    They are found by published_lights among the invariants of the pair, and raise as it does.
    """
    found = published_lights(invariants_of_pair(reduced, model), count)
    return unit(found @ np.linalg.inv(model.published).T)


def invariants_of_pair(reduced: ReducedPair, model: Model) -> Floats64:
    """Unit Γ = β/‖β‖ (n, 3) of the usable pixels in the published coordinates (Model.published).

    They are zero where the model cannot solve a pixel.
    """
    no_flash = reduced.no_flash[reduced.usable].astype(np.float64)
    flash = reduced.flash[reduced.usable].astype(np.float64)
    return unit(light_coefficients(no_flash, flash, model.tensor) @ model.published.T)


def published_lights(gammas: Floats64, count: int) -> Floats64:
    """Prune the invariants and find the lights: Algorithm 1 for two, Algorithm 2 for three.

    One light is of no interest to the source; the mean direction of the pruned invariants is
    taken, the centre of both algorithms.

    Parameters
    ----------
    gammas : (n, 3) unit invariants Γ, in the published coordinates (SpectralBasis.published);
        zero and not finite ones count as missing
    count : number of lights, 1, 2 or 3

    Returns
    -------
    (count, 3) unit coefficients, in the order in which they were found

    Raises
    ------
    UnusablePairError
        Where fewer than three invariants are left.
    ValueError
        For another count: more than three lights have no unique answer (supplement, section 2).
    """
    if count not in (1, 2, 3):
        raise ValueError(f"Lights are found for a number of 1, 2 or 3, not {count}.")
    pruned = prune(gammas[np.isfinite(gammas).all(axis=1) & gammas.any(axis=1)])
    if len(pruned) < _FEWEST:
        raise UnusablePairError(NO_AGREEMENT)
    if count == 1:
        return unit(pruned.mean(axis=0))[None]
    return two_lights(pruned) if count == 2 else three_lights(pruned)
