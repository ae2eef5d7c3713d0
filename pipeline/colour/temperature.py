"""Colour temperature of a light, and how far off white it is, from its CIE XYZ."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats64

CCT_RANGE_K = (1000.0, 15000.0)
"""Where Krystek's approximation of the locus holds."""

_MAX_DUV = 0.05
"""Farther than this from the Planckian locus a colour has no CCT (CIE 15:2018)."""


def cct_duv(xyz: ArrayLike) -> tuple[float, float] | None:
    """Correlated colour temperature in kelvin of a light's CIE XYZ (3,), and its Duv.

    None for a colour more than 0.05 (CIE 1960 uv) off the Planckian locus or outside CCT_RANGE_K.
    Duv (ANSI C78.377) is the distance from the locus in CIE 1960 uv, positive above it, where
    lights look greenish, and negative below it, where they look pink. The locus is Krystek's (1985)
    approximation.
    """
    X, Y, Z = np.asarray(xyz, dtype=np.float64)
    total = X + 15 * Y + 3 * Z
    if not total > 0:
        return None
    point = np.array([4 * X, 6 * Y]) / total
    low, high = (1e6 / kelvin for kelvin in reversed(CCT_RANGE_K))
    beyond = (high - low) / 200  # so that the ends of the range have neighbours
    low, high = low - beyond, high + beyond
    for _ in range(4):  # each round looks 100 times as closely in reciprocal temperature
        mired = np.linspace(low, high, 201)
        locus = _planckian_uv(1e6 / mired)
        distance = np.hypot(*(locus - point[:, None]))
        best = int(np.argmin(distance))
        if best in (0, mired.size - 1) or distance[best] > _MAX_DUV:
            return None
        low, high = mired[best - 1], mired[best + 1]
    kelvin = float(1e6 / mired[best])
    if not CCT_RANGE_K[0] <= round(kelvin, 1) <= CCT_RANGE_K[1]:  # found to a thousandth of it
        return None
    above = np.sign(point[1] - locus[1, best])
    return float(np.clip(kelvin, *CCT_RANGE_K)), float(above * distance[best])


def white_of(kelvin: float, duv: float) -> Floats64:
    """CIE XYZ (3,), Y = 1, of the light of a temperature and Duv: what cct_duv undoes.

    kelvin: within CCT_RANGE_K. duv: from −0.05 to 0.05. Far above the locus of warm lights no light
    is, and Z is negative.
    """
    before, point, after = _planckian_uv(np.array([0.999, 1.0, 1.001]) * kelvin).T
    u, v = after - before
    # warmer lights lie further to the right, so that this normal of the locus points up
    normal = np.array([v, -u]) / np.hypot(u, v)
    u, v = point + duv * normal
    return np.array([1.5 * u / v, 1.0, (4.0 - u - 10.0 * v) / (2.0 * v)])


def _planckian_uv(kelvin: Floats64) -> Floats64:
    """CIE 1960 uv (2, n) of black bodies, Krystek 1985, 1000 to 15000 K."""
    T = kelvin
    u = (0.860117757 + 1.54118254e-4 * T + 1.28641212e-7 * T**2) / (
        1 + 8.42420235e-4 * T + 7.08145163e-7 * T**2
    )
    v = (0.317398726 + 4.22806245e-5 * T + 4.20481691e-8 * T**2) / (
        1 - 2.89741816e-5 * T + 1.61456053e-7 * T**2
    )
    return np.array([u, v])
