"""Terminators: lines on round surfaces beyond which one lamp no longer shines.

Along a bent surface the light of every lamp changes, but evenly; only where the surface turns away
from a lamp does that lamp's light bend, from a slope to nothing. What bends is that lamp's light
alone, as what steps is at the edge of a shadow that one thing casts on another.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.matrixfit.chromaticities import Chromaticities
from pipeline.matrixfit.contrasts import RelativeLight, along, contrast, steps

_REACH = 3  # steps to either side
_SAME_SHADING = 0.3  # logarithm of the flash part, from the middle to the next
_LEAST_BEND = 0.01  # of the mean light relative to the flash
_BEYOND = 0.35  # bends two steps away, of that in the middle
_BACKWARD = 0.25  # of a step the light bends up, then down as much
_SIGNIFICANT = 5.0  # standard deviations
# the second difference in the middle less the mean of those two steps away: what is bent evenly,
# up to a cubic, is nothing, and a bend in the middle counts as in the second difference
_FACTORS = np.array([-0.5, 1.0, 0.5, -2.0, 0.5, 1.0, -0.5])
_SURFACE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def find_terminators(ratios: RelativeLight) -> list[Chromaticities]:
    """Bends of the light along surfaces of one colour, by direction; weights are their worth."""
    use = ratios.use
    if not use.any():
        return []
    least = _LEAST_BEND * float(ratios.total[use].mean())
    places = np.arange(-_REACH, _REACH + 1)
    parts = []
    for ox, oy in steps(use.shape):
        rows, columns = _bends(ratios, ox, oy, least)
        middle = (rows, columns)
        same = np.ones(len(rows), dtype=np.bool_)
        for sign in (-1, 1):
            beside = (rows + sign * oy, columns + sign * ox)
            shading = np.log(ratios.strength[beside] / ratios.strength[middle])
            same &= (np.abs(shading) < _SAME_SHADING) & ratios.alike(beside, middle)
        at = rows[same, None] + oy * places, columns[same, None] + ox * places
        parts.append(contrast(ratios, at, _FACTORS, _SURFACE, _SIGNIFICANT))
    return parts


def _bends(
    ratios: RelativeLight, ox: int, oy: int, least: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns where light bends upwards along (ox, oy), and not beyond."""
    views = along(ratios.use.shape, ox, oy, _REACH)
    if not views:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    light = [ratios.total[view] for view in views]
    before, rising, middle, falling, after = (
        a - 2.0 * b + c for a, b, c in zip(light, light[1:], light[2:], strict=False)
    )
    good = middle > least
    good &= np.abs(before) + np.abs(after) < _BEYOND * middle
    good &= np.minimum(rising, falling) > -_BACKWARD * middle
    for view in views:
        good &= ratios.use[view]
    rows, columns = np.nonzero(good)
    return rows + _REACH * abs(oy), columns + _REACH * ox
