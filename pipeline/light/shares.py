"""How much of each lamp a pixel holds: non-negative least squares in the image, in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.arrays import Floats32
from pipeline.compiling import exact, spliced
from pipeline.images.frames import Colour

_REGULAR = 1e-6  # relative determinant below which lamps are too alike at a pixel to be told apart
_LEAST = 1e-30  # squares and determinants below it are beyond single precision: black


def shares(no_flash: Floats32, predictions: Floats32) -> Floats32:
    """Non-negative z that bring Σ_j z_j · predictions_j nearest to the no-flash photograph.

    Every subset of up to three lamps is solved exactly and the best one with z ≥ 0 is taken
    (Lawson and Hanson 1974 shows that the minimum is one of these).

    Parameters
    ----------
    no_flash : (..., 3) linear camera RGB
    predictions : (N, ..., 3), T_j I_flash of each lamp, N = 1, 2 or 3

    Returns
    -------
    (N, ...) float32
    """
    count, shape = len(predictions), no_flash.shape[:-1]
    light = np.ascontiguousarray(no_flash, dtype=np.float32).reshape(-1, 3)
    found = np.empty((count, len(light)), dtype=np.float32)
    _shares(light, np.ascontiguousarray(predictions, np.float32).reshape(count, -1, 3), found)
    return found.reshape(count, *shape)


@exact
def _shares(light: Floats32, predictions: Floats32, found: Floats32) -> None:
    """Write shares (N, n) of n pixels."""
    for i in range(light.shape[0]):
        seen = light[i, 0], light[i, 1], light[i, 2]
        p = predictions[0, i]
        first = p[0], p[1], p[2]
        if len(predictions) == 1:
            found[0, i] = _share_of_one(seen, first)
            continue
        p = predictions[1, i]
        second = p[0], p[1], p[2]
        if len(predictions) == 2:
            z0, z1, scale = shares_of_two(seen, first, second)
            found[0, i], found[1, i] = z0 / scale, z1 / scale
            continue
        p = predictions[2, i]
        found[0, i], found[1, i], found[2, i] = shares_of_three(
            seen, first, second, (p[0], p[1], p[2])
        )


@spliced
def dot(a: Colour, b: Colour) -> Any:
    """Sum over the channels, for other compiled loops, too, in the precision of its arguments."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@spliced
def doubles(a: Colour) -> Colour:
    """In double precision, for other compiled loops, too: what looks alike at a pixel needs it."""
    return np.float64(a[0]), np.float64(a[1]), np.float64(a[2])


@spliced
def _cross(a: Colour, b: Colour) -> Colour:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@spliced
def _alone(seen: float, power: float) -> float:
    share = seen / power
    return share if (power > 0) & (seen > 0) else 0.0


@spliced
def _together(
    s0: float, s1: float, g00: float, g01: float, g11: float
) -> tuple[float, float, float]:
    """Shares of two lamps that are both there, and what they explain; −1 where they are not."""
    determinant = g00 * g11 - g01 * g01
    z0, z1 = (g11 * s0 - g01 * s1), (g00 * s1 - g01 * s0)
    there = (determinant > _REGULAR * g00 * g11) & (z0 >= 0) & (z1 >= 0)
    z0, z1 = z0 / determinant, z1 / determinant
    explained = z0 * s0 + z1 * s1
    return z0, z1, explained if there else -1.0


@exact
def _share_of_one(seen: Colour, first: Colour) -> float:
    """Share of one pixel, as shares defines it."""
    seen, first = doubles(seen), doubles(first)
    return _alone(dot(first, seen), dot(first, first))


@spliced
def shares_of_two(seen: Colour, first: Colour, second: Colour) -> tuple[Any, Any, Any]:
    """Shares of one pixel, as shares defines them, times a scale > 0, and the scale.

    For other compiled loops, which need not divide where the ratio of shares is enough. Without
    branches, so that loops over pixels become vector instructions, and in the precision of its
    arguments: cross products keep what a difference of squares would lose.
    """
    s0, s1 = dot(first, seen), dot(second, seen)
    g00, g11 = dot(first, first), dot(second, second)
    normal = _cross(first, second)
    determinant = dot(normal, normal)  # g00 · g11 − g01², by Lagrange's identity
    z0, z1 = dot(normal, _cross(seen, second)), dot(normal, _cross(first, seen))
    zero, least = np.float32(0.0), np.float32(_LEAST)
    # no solution on the border is better than one inside
    both = (determinant > np.float32(_REGULAR) * g00 * g11) & (z0 >= 0) & (z1 >= 0)
    both &= determinant > least
    one = s0 if (g00 > least) & (s0 > 0) else zero
    other = s1 if (g11 > least) & (s1 > 0) else zero
    # s²/g is what a lamp explains alone; a black one explains nothing
    weaker = (other > 0) & ((one <= 0) | (one * one * g11 < other * other * g00))
    one, other = (zero if weaker else one), (other if weaker else zero)
    scale = determinant if both else max(g11 if weaker else g00, least)
    return (z0 if both else one), (z1 if both else other), scale


@spliced
def shares_of_three(
    seen: Colour, first: Colour, second: Colour, third: Colour
) -> tuple[float, float, float]:
    """Shares of one pixel, as shares defines them; for other compiled loops, without branches."""
    seen, first, second, third = doubles(seen), doubles(first), doubles(second), doubles(third)
    s0, s1, s2 = dot(first, seen), dot(second, seen), dot(third, seen)
    g00, g01, g02 = dot(first, first), dot(first, second), dot(first, third)
    g11, g12, g22 = dot(second, second), dot(second, third), dot(third, third)
    c00, c01, c02 = g11 * g22 - g12 * g12, g02 * g12 - g01 * g22, g01 * g12 - g02 * g11
    c11, c12, c22 = g00 * g22 - g02 * g02, g01 * g02 - g00 * g12, g00 * g11 - g01 * g01
    determinant = g00 * c00 + g01 * c01 + g02 * c02
    all0 = c00 * s0 + c01 * s1 + c02 * s2
    all1 = c01 * s0 + c11 * s1 + c12 * s2
    all2 = c02 * s0 + c12 * s1 + c22 * s2
    there = (determinant > _REGULAR**1.5 * g00 * g11 * g22) & (all0 >= 0) & (all1 >= 0)
    there &= all2 >= 0
    # else the best of the solutions that lack a lamp
    z0, z1, z2 = _alone(s0, g00), 0.0, 0.0
    gain = z0 * s0
    one = _alone(s1, g11)
    better = one * s1 > gain
    gain, z0, z1 = (one * s1 if better else gain), (0.0 if better else z0), (one if better else z1)
    one = _alone(s2, g22)
    better = one * s2 > gain
    gain, z0 = (one * s2 if better else gain), (0.0 if better else z0)
    z1, z2 = (0.0 if better else z1), (one if better else z2)
    a, b, explained = _together(s0, s1, g00, g01, g11)
    better = explained > gain
    gain, z0 = (explained if better else gain), (a if better else z0)
    z1, z2 = (b if better else z1), (0.0 if better else z2)
    a, b, explained = _together(s0, s2, g00, g02, g22)
    better = explained > gain
    gain, z0 = (explained if better else gain), (a if better else z0)
    z1, z2 = (0.0 if better else z1), (b if better else z2)
    a, b, explained = _together(s1, s2, g11, g12, g22)
    better = explained > gain
    z0, z1, z2 = (0.0 if better else z0), (a if better else z1), (b if better else z2)
    return (
        all0 / determinant if there else z0,
        all1 / determinant if there else z1,
        all2 / determinant if there else z2,
    )
