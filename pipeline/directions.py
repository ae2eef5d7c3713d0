"""Directions to lamps, as a user gives them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import OptionError
from pipeline.options import DirectedLight
from pipeline.vectors import unit

_MIN_VOLUME = 0.02  # of the parallelepiped, or area of the parallelogram, of the unit directions


def unit_directions(lights: Sequence[DirectedLight]) -> NDArray[np.float64]:
    """Unit directions (J, 3) to lamps.

    Raises OptionError for those that fix no normals, and where all lie behind the surface.
    """
    given = np.array([light.direction for light in lights], dtype=np.float64)
    # any length is allowed, of which the square may be no number
    directions = unit(given / np.abs(given).max(axis=1, keepdims=True))
    if (directions[:, 2] <= 0).all():
        raise OptionError(
            "None of the light directions points to the camera's side: z goes from the surface to "
            "the camera, so turn its sign."
        )
    volume = np.sqrt(max(np.linalg.det(directions @ directions.T), 0.0))
    if volume < _MIN_VOLUME:
        raise OptionError(
            "The light directions are nearly alike, or lie nearly in one plane, which fixes no "
            "normals: place the lamps more widely around the camera."
        )
    return directions
