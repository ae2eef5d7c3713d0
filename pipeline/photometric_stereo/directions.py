"""Directions to lamps, as a user gives them, and which of the lamps found are meant."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.errors import OptionError
from pipeline.options import DirectedLight
from pipeline.vectors import unit

_MIN_VOLUME = 0.02  # of the parallelepiped, or area of the parallelogram, of the unit directions


def unit_directions(lights: Sequence[DirectedLight]) -> Floats64:
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


def likely_orders(lights: Sequence[DirectedLight], whites: Floats64) -> list[tuple[int, ...]]:
    """Orders of the lamps found that may be those of the lights.

    whites: (J, 3) camera RGB of a grey card under each lamp found, as many as lights. The lights
    of which `rgb` is given are the lamps that are together most like it; the others are any of
    those left, so that without a colour all orders are likely, and one is where all are given.
    """
    named = [index for index, light in enumerate(lights) if light.rgb]
    colours = unit(np.array([lights[index].rgb for index in named], np.float64).reshape(-1, 3))
    likeness = colours @ unit(whites).T
    orders = list(permutations(range(len(lights))))

    def of_named(order: tuple[int, ...]) -> list[int]:
        return [order[index] for index in named]

    best = max(orders, key=lambda order: likeness[range(len(named)), of_named(order)].sum())
    return [order for order in orders if of_named(order) == of_named(best)]
