"""Pools of light: what a lamp close to a wall or a table draws on it.

On a flat surface the light of every lamp changes, but that of lamps far away nearly straight; only
near a lamp does it bend much. What bends is mostly that lamp's light alone, or, where two pools
overlap, that of two. Round things bend the light of all lamps: the flash tells them by its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.images.frames import Mask
from pipeline.matrixfit.chromaticities import Chromaticities, draw
from pipeline.matrixfit.contrasts import RelativeLight, along, contrast, steps
from pipeline.vectors import cross_2d

_REACHES = (2, 4)  # steps to either side; the wider stands out from more noise
_FLAT = 0.03  # logarithm of the flash part, from the middle to each side
_LEAST_BEND = 0.02  # of the mean light around
_EVERY = 0.1  # share of each of three lamps in what bends
_MOST = 2000  # of a direction and a reach: more tell no more
_SIDES = np.array([-1, 0, 1])
_FACTORS, _SURFACE = np.array([1.0, -2.0, 1.0]), np.array([0.0, 1.0, 0.0])


def find_pools(ratios: RelativeLight) -> list[Chromaticities]:
    """Bends of the light on flat surfaces of one colour, by direction; weights are their worth."""
    if not ratios.use.any():
        return []
    shading = np.log(ratios.strength)
    parts = []
    for dx, dy in steps(ratios.use.shape):
        for reach in _REACHES:
            ox, oy = reach * dx, reach * dy
            bend, rows, columns = _bends(ratios, shading, ox, oy)
            for sign in (1.0, -1.0):
                which = sign * bend > 0
                worth = np.sqrt(np.abs(bend[which]) * ratios.strength[rows, columns][which])
                pick = np.flatnonzero(which)[draw(worth, _MOST)]
                at = rows[pick, None] + oy * _SIDES, columns[pick, None] + ox * _SIDES
                parts.append(contrast(ratios, at, sign * _FACTORS, _SURFACE))
    return parts


def without_coves(pools: Chromaticities, matrices: Floats64) -> Chromaticities:
    """Pools but those in which the light of all three lamps (3, 3, 3) bends.

    So it does where a backdrop bends from table to wall, which the flash lights too evenly to tell.
    """
    u, (a, b, c) = pools.u, pools.corners(matrices)
    whole = cross_2d(b - a, c - a)
    parts = np.array([cross_2d(p - u, q - u) for p, q in ((b, c), (c, a), (a, b))])
    keep = (np.sign(whole) * parts).min(axis=0) <= _EVERY * np.abs(whole)
    return Chromaticities(pools.x[keep], u[keep], pools.covariance[keep], pools.weight[keep])


def _bends(
    ratios: RelativeLight, shading: Floats64, ox: int, oy: int
) -> tuple[Floats64, NDArray[np.intp], NDArray[np.intp]]:
    """Second differences along (ox, oy), ox ≥ 0, on flat surfaces, and their rows and columns."""
    views = along(ratios.use.shape, ox, oy, 1)
    if not views:
        return np.zeros(0), np.zeros(0, np.intp), np.zeros(0, np.intp)
    before, middle, after = (ratios.total[view] for view in views)
    bend = before - 2.0 * middle + after
    good: Mask = np.abs(bend) > _LEAST_BEND / 4 * (before + 2.0 * middle + after)
    for view in views:
        good &= ratios.use[view] & (np.abs(shading[view] - shading[views[1]]) < _FLAT)
    rows, columns = np.nonzero(good)
    bend, rows, columns = bend[good], rows + abs(oy), columns + ox
    same = np.ones(len(rows), np.bool_)
    for part in (-1.0, -0.5, 0.5, 1.0):
        beside = rows + round(part * oy), columns + round(part * ox)
        same &= ratios.alike(beside, (rows, columns))
    return bend[same], rows[same], columns[same]
