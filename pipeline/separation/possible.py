"""How far layers are from all that lamps could have made of the photograph."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats, Floats64


def off_possible(photograph: Floats, layers: Floats) -> Floats64:
    """Distance (...) of layers (N, ..., 3) from the nearest that are ≥ 0 and add up.

    photograph: (..., 3) what they are to add up to. As the true layers are such, these are at least
    so far from them. The nearest are found by projection on a simplex (Held, Wolfe and Crowder
    1974, "Validation of subgradient optimization").
    """
    given = np.asarray(layers, dtype=np.float64)
    falling = -np.sort(-given, axis=0)
    number = np.arange(1, len(given) + 1).reshape(-1, *[1] * photograph.ndim)
    too_much = (falling.cumsum(axis=0) - photograph) / number  # of each of so many layers
    last = np.maximum((falling > too_much).sum(axis=0, keepdims=True) - 1, 0)
    nearest = np.maximum(given - np.take_along_axis(too_much, last, axis=0), 0.0)
    return np.asarray(np.sqrt(np.square(given - nearest).sum(axis=(0, -1))))
