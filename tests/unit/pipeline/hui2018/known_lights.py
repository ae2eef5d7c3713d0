"""Lights as the published method looks for them: unit vectors on the sphere of invariants."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.vectors import unit

LIGHTS = unit(np.array([[0.7, 0.65, 0.3], [0.35, 0.9, 0.3], [0.3, 0.64, 0.71]]))
WARM, GREEN, COOL = LIGHTS


def worst_angle(found: Floats64, lights: Floats64) -> float:
    """Largest angle in degrees between a light and the found one nearest to it."""
    cosines = (lights @ found.T).max(axis=1)
    return float(np.degrees(np.arccos(np.clip(cosines.min(), -1, 1))))
