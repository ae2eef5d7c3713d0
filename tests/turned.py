"""Directions that are off."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.vectors import unit


def turned(directions: Floats64, degrees: float) -> Floats64:
    """Unit directions (J, 3), each turned by so much to another side."""
    across = unit(np.cross(directions, np.roll(directions, 1, axis=0)))
    angle = np.radians(degrees)
    return np.asarray(np.cos(angle) * unit(directions) + np.sin(angle) * across)
