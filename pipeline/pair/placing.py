"""Lays what a moved flash photograph shows beside edges where the other photograph has them.

A photograph that was laid on another lies a fraction of a pixel beside it, and interpolation draws
its edges otherwise. The no-flash photograph knows where its edges are: light and proportions that
do not fit there are taken from neighbours that are well placed, by colour. Compiled.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32
from pipeline.compiling import exact, spliced
from pipeline.images.frames import (
    Colour,
    Image,
    Numbers,
    Plane,
    Planes,
    by_planes,
    channels_first,
    numbers_of,
    planes_of,
)
from pipeline.images.noise import Noise

_MISPLACED = 0.03  # of the flash part: the deviation at which a pixel is placed by half
_WELL = 0.7  # placed so well that nothing needs to be mended, at 2 % of the flash part
_REACH, _SPREAD = 2, 1.0  # of the regression, in pixels
_ALIKE_REACH, _ALIKE_SPREAD = 4, 2.0  # of the average
_LEAST = 0.05  # what the worst placed pixel counts in the regression
_STEP = 1e-4  # (0.01)², steps of the colour smaller than this part of the light are noise
_SAME = 2 * 0.07**2  # difference of colours, squared, relative to the light's
_KNOWN = 0.2  # confidence below which a pixel's own proportions say little
_ENOUGH = 0.1  # well placed neighbours of a pixel's own colour
HALO = _REACH + _ALIKE_REACH
"""Rows beyond either end of a strip that place_flash and then mend_proportions need."""


def placement(part: Plane, variance: Plane) -> Plane:
    """How well a flash part is placed, (h, w) 0…1: half where it deviates by 3 % of itself.

    part: (h, w) sum over the channels. variance: (h, w) of the sum, from registration_variance.
    """
    squared = np.square(np.maximum(part, 0.0))
    return np.asarray(squared / np.maximum(squared + variance / _MISPLACED**2, 1e-30), np.float32)


def place_flash(no_flash: Image, flash: Image, placed: Plane, confidence: Plane) -> Image:
    """Give a flash part the edges of the no-flash photograph where it is not well placed.

    Its colour is regressed on that of the no-flash photograph over the 5 × 5 pixels around, those
    nearer and better placed counting for more (locally weighted regression, Cleveland 1979).

    Parameters
    ----------
    no_flash, flash : (h, W, 3) linear camera RGB, flash the flash part alone
    placed : (h, W) 0…1, of placement
    confidence : (h, W) 0…1, what a pixel's light is worth

    Returns
    -------
    (h, W, 3) float32, the flash part as it was where placed is .7 or more, else ≥ 0. The two
    outermost rows are not as those of a larger picture.
    """
    out = by_planes(*flash.shape)
    out[...] = flash
    _regress(planes_of(no_flash), planes_of(flash), placed, confidence, _kernel(), planes_of(out))
    return out


def mend_proportions(
    smooth: Floats32,
    proportions: Floats32,
    photograph: Image,
    noise: Noise,
    placed: Plane,
    confidence: Plane,
    keep: slice,
) -> tuple[Floats32, Plane]:
    """Give pixels that are not well placed the proportions of well placed ones of their colour.

    Pixels without a usable flash part, as along the border, get them, too: a mean over the 9 × 9
    pixels around, weighed by how near they are in place and in colour (cross bilateral filter,
    Eisemann and Durand 2004, Petschnigg et al. 2004).

    Parameters
    ----------
    smooth : (N, len(keep), W, 3) 0…1, what became of proportions
    proportions : (N, h, W, 3) 0…1, pixel by pixel
    photograph : (h, W, 3), the no-flash photograph, of the given noise
    placed, confidence : (h, W) 0…1, as place_flash takes them
    keep : the rows of smooth; the four on either side, or up to the border, are halo

    Returns
    -------
    (N, len(keep), W, 3) float32, 0…1, smooth where placed is .7 or more and confidence .2
    (len(keep), W) float32, 0…1, how far to trust them: confidence, or more where neighbours tell
    """
    if len(smooth) == 1:
        return smooth, confidence[keep]
    out = by_planes(*smooth.shape)
    out[...] = smooth
    trust = confidence[keep].copy()
    first, _, _ = keep.indices(len(placed))
    _average(
        tuple(planes_of(one) for one in proportions),
        planes_of(photograph),
        (numbers_of(noise.gain), numbers_of(noise.floor)),
        placed,
        confidence,
        first,
        channels_first(out),
        trust,
    )
    return out, trust


def _kernel() -> Floats32:
    """Weights (2·reach + 1)² of the regression by place."""
    steps = np.arange(-_REACH, _REACH + 1)
    line = np.exp(-np.square(steps) / (2 * _SPREAD**2))
    return np.outer(line, line).astype(np.float32)


@exact
def _regress(
    guide: Planes, flash: Planes, placed: Plane, confidence: Plane, kernel: Floats32, out: Planes
) -> None:
    """Write the regressed flash part into out, as far as pixels are not well placed.

    With a pixel's own colour as the origin, steps g of the others from it and their weighted mean
    ḡ and covariance C, the regression's value at the pixel is the mean of f·(1 − ḡᵀC⁻¹(g − ḡ)).
    """
    height, width = placed.shape
    steps, weights = np.empty((3, kernel.size)), np.empty(kernel.size)
    for y in range(height):
        for x in range(width):
            if placed[y, x] >= _WELL:
                continue
            own = guide[0][y, x], guide[1][y, x], guide[2][y, x]
            top, bottom = max(y - _REACH, 0), min(y + _REACH + 1, height)
            left, right = max(x - _REACH, 0), min(x + _REACH + 1, width)
            n, total, g0, g1, g2 = 0, 0.0, 0.0, 0.0, 0.0
            c00, c01, c02, c11, c12, c22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for j in range(top, bottom):
                for i in range(left, right):
                    weight = np.float64(kernel[j - y + _REACH, i - x + _REACH])
                    weight *= max(placed[j, i], _LEAST) * (confidence[j, i] + 1e-6)
                    a = np.float64(guide[0][j, i] - own[0])
                    b = np.float64(guide[1][j, i] - own[1])
                    c = np.float64(guide[2][j, i] - own[2])
                    steps[0, n], steps[1, n], steps[2, n], weights[n] = a, b, c, weight
                    n, total = n + 1, total + weight
                    g0, g1, g2 = g0 + weight * a, g1 + weight * b, g2 + weight * c
                    c00, c01, c02 = (
                        c00 + weight * a * a,
                        c01 + weight * a * b,
                        c02 + weight * a * c,
                    )
                    c11, c12, c22 = (
                        c11 + weight * b * b,
                        c12 + weight * b * c,
                        c22 + weight * c * c,
                    )
            g0, g1, g2 = g0 / total, g1 / total, g2 / total
            light = (own[0] + g0) ** 2 + (own[1] + g1) ** 2 + (own[2] + g2) ** 2
            least = _STEP * light + 1e-14
            s0, s1, s2 = _solved(
                (
                    c00 / total - g0 * g0 + least,
                    c01 / total - g0 * g1,
                    c02 / total - g0 * g2,
                    c11 / total - g1 * g1 + least,
                    c12 / total - g1 * g2,
                    c22 / total - g2 * g2 + least,
                ),
                (g0, g1, g2),
            )
            p, q, r, n = 0.0, 0.0, 0.0, 0
            for j in range(top, bottom):
                for i in range(left, right):
                    off = s0 * (steps[0, n] - g0) + s1 * (steps[1, n] - g1)
                    off += s2 * (steps[2, n] - g2)
                    weight = weights[n] / total * (1.0 - off)
                    p += weight * flash[0][j, i]
                    q += weight * flash[1][j, i]
                    r += weight * flash[2][j, i]
                    n += 1
            share = 1.0 - placed[y, x] / _WELL
            out[0][y, x] += share * (max(p, 0.0) - out[0][y, x])
            out[1][y, x] += share * (max(q, 0.0) - out[1][y, x])
            out[2][y, x] += share * (max(r, 0.0) - out[2][y, x])


@spliced
def _solved(c: Numbers, g: Colour) -> tuple[float, float, float]:
    """C⁻¹ g of a positive definite C, its upper triangle row by row, by Cholesky's factors."""
    l00 = np.sqrt(c[0])
    l10, l20 = c[1] / l00, c[2] / l00
    l11 = np.sqrt(max(c[3] - l10 * l10, 1e-18))
    l21 = (c[4] - l20 * l10) / l11
    l22 = np.sqrt(max(c[5] - l20 * l20 - l21 * l21, 1e-18))
    z0 = g[0] / l00
    z1 = (g[1] - l10 * z0) / l11
    z2 = (g[2] - l20 * z0 - l21 * z1) / l22
    s2 = z2 / l22
    s1 = (z1 - l21 * s2) / l11
    return (z0 - l10 * s1 - l20 * s2) / l00, s1, s2


@exact
def _average(
    proportions: tuple[Planes, ...],
    photograph: Planes,
    noise: tuple[Numbers, Numbers],
    placed: Plane,
    confidence: Plane,
    first: int,
    smooth: Floats32,
    trust: Plane,
) -> None:
    """Go from smooth (N, 3, h, w) to the averages as far as pixels' own say little.

    first: the row of all others that belongs to row 0 of smooth. trust: (h, w), raised as far.
    """
    height, width = placed.shape
    side = 2 * _ALIKE_REACH + 1
    places, weights = np.empty((2, side * side), np.int64), np.empty(side * side)
    near = np.exp(-(np.arange(-_ALIKE_REACH, _ALIKE_REACH + 1) ** 2) / (2 * _ALIKE_SPREAD**2))
    for y in range(first, first + smooth.shape[2]):
        for x in range(width):
            worth = min(placed[y, x] / _WELL, confidence[y, x] / _KNOWN)
            if worth >= 1.0:
                continue
            own = photograph[0][y, x], photograph[1][y, x], photograph[2][y, x]
            same, tolerance = 0.0, 0.0
            for k in range(3):
                same += own[k] * own[k]
                tolerance += noise[0][k] * max(own[k], np.float32(0.0)) + noise[1][k]
            tolerance = 1.0 / (_SAME * same + 2.0 * tolerance + 1e-12)
            n, total = 0, 0.0
            for j in range(max(y - _ALIKE_REACH, 0), min(y + _ALIKE_REACH + 1, height)):
                for i in range(max(x - _ALIKE_REACH, 0), min(x + _ALIKE_REACH + 1, width)):
                    a = photograph[0][j, i] - own[0]
                    b = photograph[1][j, i] - own[1]
                    c = photograph[2][j, i] - own[2]
                    unlike = 1.0 + tolerance * (a * a + b * b + c * c)
                    weight = near[j - y + _ALIKE_REACH] * near[i - x + _ALIKE_REACH]
                    weight *= placed[j, i] * confidence[j, i] / (unlike * unlike)
                    places[0, n], places[1, n], weights[n] = j, i, weight
                    n, total = n + 1, total + weight
            if total <= 0:
                continue
            share = (1.0 - worth) * min(total / _ENOUGH, 1.0)
            trust[y - first, x] += share * (1.0 - trust[y - first, x])
            for lamp in range(len(smooth)):
                for k in range(3):
                    mean = 0.0
                    for m in range(n):
                        mean += weights[m] * proportions[lamp][k][places[0, m], places[1, m]]
                    smooth[lamp, k, y - first, x] += share * (
                        mean / total - smooth[lamp, k, y - first, x]
                    )
