"""Lays what a moved flash photograph shows beside edges where the other photograph has them.

A photograph that was laid on another lies a fraction of a pixel beside it, and interpolation draws
its edges otherwise. The no-flash photograph knows where its edges are: light and proportions that
do not fit there are taken from neighbours that are well placed, by colour. Compiled.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.arrays import Floats32
from pipeline.compiling import compiled, inlined
from pipeline.images.frames import (
    Colour,
    Image,
    Numbers,
    Plane,
    by_planes,
    channels_first,
    numbers_of,
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
_TOGETHER = 64  # pixels of a row worked on by vector instructions, where one of them needs it
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
    counts = np.maximum(placed, np.float32(_LEAST)) * (confidence + np.float32(1e-6))
    guide, part = (_bordered(channels_first(one), _REACH) for one in (no_flash, flash))
    _regress(
        guide, part, _bordered(counts, _REACH), _near(_REACH, _SPREAD), placed, channels_first(out)
    )
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
    smooth : (N, len(keep), W, 3) 0…1, what became of proportions; they add up to 1
    proportions : (N, h, W, 3) 0…1, pixel by pixel; they add up to 1
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
    worth = np.minimum(placed[keep] / np.float32(_WELL), confidence[keep] / np.float32(_KNOWN))
    first, _, _ = keep.indices(len(placed))
    _average(
        _bordered(channels_first(proportions[:-1]).reshape(-1, *placed.shape), _ALIKE_REACH),
        _bordered(channels_first(photograph), _ALIKE_REACH),
        _bordered(placed * confidence, _ALIKE_REACH),
        _near(_ALIKE_REACH, _ALIKE_SPREAD),
        (numbers_of(noise.gain), numbers_of(noise.floor)),
        worth,
        first,
        channels_first(out),
        trust,
    )
    return out, trust


def _near(reach: int, spread: float) -> Floats32:
    """Weights (2·reach + 1)² of neighbours by place."""
    steps = np.arange(-reach, reach + 1)
    line = np.exp(-np.square(steps) / (2 * spread**2))
    return np.outer(line, line).astype(np.float32)


def _bordered(planes: Floats32, width: int) -> Floats32:
    """Planes (…, h, w) within so many zeros, so that no window reaches beyond them."""
    *_, height, length = planes.shape
    inner = slice(width, width + height), slice(width, width + length)
    laid = np.zeros((*planes.shape[:-2], height + 2 * width, length + 2 * width), np.float32)
    laid[..., *inner] = planes
    return laid


@compiled
def _regress(
    guide: Floats32,
    flash: Floats32,
    counts: Plane,
    near: Floats32,
    placed: Plane,
    out: Floats32,
) -> None:
    """Write the regressed flash part into out (3, h, W), as far as pixels are not well placed.

    With a pixel's own colour as the origin, steps g of the others from it and their weighted mean
    ḡ and covariance C, the regression's value at the pixel is the mean of f·(1 − ḡᵀC⁻¹(g − ḡ)).

    guide, flash, counts: within a border; counts, what each pixel counts wherever it lies.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    means, products = np.empty(4 * _TOGETHER, np.float32), np.empty(6 * _TOGETHER, np.float32)
    pull, value = np.empty(3 * _TOGETHER, np.float32), np.empty(3 * _TOGETHER, np.float32)
    side = len(near)
    height, width = placed.shape
    for y in range(height):
        for left in range(0, width, _TOGETHER):
            there = placed[y, left : left + _TOGETHER]
            n = len(there)
            if _least(there) >= np.float32(_WELL):
                continue
            own = _row(guide, y + _REACH, left + _REACH, n)
            means[:], products[:], value[:] = zero, zero, zero
            for j in range(side):
                for i in range(side):
                    others = _row(guide, y + j, left + i, n)
                    count = counts[y + j, left + i : left + i + n]
                    _sum_steps(own, others, count, near[j, i], means)
            _divide(means)
            for j in range(side):
                for i in range(side):
                    others = _row(guide, y + j, left + i, n)
                    count = counts[y + j, left + i : left + i + n]
                    _sum_products(own, others, count, near[j, i], means, products)
            _solve(own, means, products, pull)
            for j in range(side):
                for i in range(side):
                    others = _row(guide, y + j, left + i, n)
                    parts = _row(flash, y + j, left + i, n)
                    count = counts[y + j, left + i : left + i + n]
                    _sum_pulled(own, others, parts, count, near[j, i], means, pull, value)
            for k in range(3):
                found = out[k, y, left : left + _TOGETHER]
                regressed = value[k * _TOGETHER : k * _TOGETHER + n]
                for x in range(n):
                    share = max(one - there[x] / np.float32(_WELL), zero)
                    found[x] += share * (max(regressed[x], zero) - found[x])


@inlined
def _row(planes: Floats32, y: int, left: int, count: int) -> Colour:
    """So many pixels of a row of three planes."""
    right = left + count
    return planes[0, y, left:right], planes[1, y, left:right], planes[2, y, left:right]


@inlined
def _least(values: Floats32) -> Any:
    least = values[0]
    for x in range(len(values)):
        least = min(least, values[x])
    return least


@inlined
def _sum_steps(own: Colour, others: Colour, count: Any, near: Any, means: Any) -> None:
    """Add neighbours' weight, and their steps from pixels' own colour, weighed (4, n)."""
    a0, a1, a2 = own
    b0, b1, b2 = others
    for x in range(len(count)):
        weight = near * count[x]
        means[x] += weight
        means[x + _TOGETHER] += weight * (b0[x] - a0[x])
        means[x + 2 * _TOGETHER] += weight * (b1[x] - a1[x])
        means[x + 3 * _TOGETHER] += weight * (b2[x] - a2[x])


@inlined
def _sum_products(
    own: Colour, others: Colour, count: Any, near: Any, means: Any, products: Any
) -> None:
    """Add products of neighbours' steps from the mean, weighed (6, n).

    Of steps from pixels' own colour, less the mean's, too little would be left in single precision.
    """
    a0, a1, a2 = own
    b0, b1, b2 = others
    for x in range(len(count)):
        weight = near * count[x]
        a = b0[x] - a0[x] - means[x + _TOGETHER]
        b = b1[x] - a1[x] - means[x + 2 * _TOGETHER]
        c = b2[x] - a2[x] - means[x + 3 * _TOGETHER]
        wa, wb = weight * a, weight * b
        products[x] += wa * a
        products[x + _TOGETHER] += wa * b
        products[x + 2 * _TOGETHER] += wa * c
        products[x + 3 * _TOGETHER] += wb * b
        products[x + 4 * _TOGETHER] += wb * c
        products[x + 5 * _TOGETHER] += weight * c * c


@inlined
def _divide(means: Any) -> None:
    """Write 1 ÷ the weight, and means in place of sums (4, n)."""
    for x in range(_TOGETHER):
        means[x] = np.float32(1.0) / means[x]
        means[x + _TOGETHER] *= means[x]
        means[x + 2 * _TOGETHER] *= means[x]
        means[x + 3 * _TOGETHER] *= means[x]


@inlined
def _solve(own: Colour, means: Any, products: Any, pull: Any) -> None:
    """Write C⁻¹ḡ, by Cholesky's factors (3, n)."""
    a0, a1, a2 = own
    least = np.float32(1e-18)
    for x in range(len(a0)):
        share, g0 = means[x], means[x + _TOGETHER]
        g1, g2 = means[x + 2 * _TOGETHER], means[x + 3 * _TOGETHER]
        m0, m1, m2 = a0[x] + g0, a1[x] + g1, a2[x] + g2
        noise = np.float32(_STEP) * (m0 * m0 + m1 * m1 + m2 * m2) + np.float32(1e-14)
        l00 = np.sqrt(products[x] * share + noise)
        l10, l20 = products[x + _TOGETHER] * share / l00, products[x + 2 * _TOGETHER] * share / l00
        l11 = np.sqrt(max(products[x + 3 * _TOGETHER] * share + noise - l10 * l10, least))
        l21 = (products[x + 4 * _TOGETHER] * share - l20 * l10) / l11
        left = products[x + 5 * _TOGETHER] * share + noise - l20 * l20 - l21 * l21
        l22 = np.sqrt(max(left, least))
        z0 = g0 / l00
        z1 = (g1 - l10 * z0) / l11
        s2 = (g2 - l20 * z0 - l21 * z1) / l22 / l22
        s1 = (z1 - l21 * s2) / l11
        pull[x] = (z0 - l10 * s1 - l20 * s2) / l00
        pull[x + _TOGETHER] = s1
        pull[x + 2 * _TOGETHER] = s2


@inlined
def _sum_pulled(
    own: Colour,
    others: Colour,
    parts: Colour,
    count: Any,
    near: Any,
    means: Any,
    pull: Any,
    value: Any,
) -> None:
    """Add neighbours' flash part, weighed as the regression weighs it (3, n)."""
    a0, a1, a2 = own
    b0, b1, b2 = others
    f0, f1, f2 = parts
    for x in range(len(count)):
        off = pull[x] * (b0[x] - a0[x] - means[x + _TOGETHER])
        off += pull[x + _TOGETHER] * (b1[x] - a1[x] - means[x + 2 * _TOGETHER])
        off += pull[x + 2 * _TOGETHER] * (b2[x] - a2[x] - means[x + 3 * _TOGETHER])
        weight = near * count[x] * means[x] * (np.float32(1.0) - off)
        value[x] += weight * f0[x]
        value[x + _TOGETHER] += weight * f1[x]
        value[x + 2 * _TOGETHER] += weight * f2[x]


@compiled
def _average(
    proportions: Floats32,
    photograph: Floats32,
    counts: Plane,
    near: Floats32,
    noise: tuple[Numbers, Numbers],
    worth: Plane,
    first: int,
    smooth: Floats32,
    trust: Plane,
) -> None:
    """Go from smooth (N, 3, h, w) to the averages as far as pixels' own say little.

    proportions: (3·(N − 1), …), without the last lamp, which has what the others leave; they,
    photograph and counts, what a neighbour's proportions are worth, within a border. worth: (h, w)
    of pixels' own, 1 and more where they stay. first: the row of all others that belongs to row 0
    of smooth. trust: (h, w), raised as far.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    scratch = np.empty((4, _TOGETHER), np.float32)
    tolerance, weight, total, share = scratch[0], scratch[1], scratch[2], scratch[3]
    lamps = len(proportions) // 3
    sums = np.empty((len(proportions), _TOGETHER), np.float32)
    left_over = np.empty(_TOGETHER, np.float32)
    for row in range(smooth.shape[2]):
        for left in range(0, smooth.shape[3], _TOGETHER):
            there = worth[row, left : left + _TOGETHER]
            n = len(there)
            if _least(there) >= one:
                continue
            y = first + row
            own = _row(photograph, y + _ALIKE_REACH, left + _ALIKE_REACH, n)
            _tolerate(own, noise, tolerance)
            total[:], sums[:] = zero, zero
            for j in range(len(near)):
                for i in range(len(near)):
                    others = _row(photograph, y + j, left + i, n)
                    count = counts[y + j, left + i : left + i + n]
                    _weigh_alike(own, others, count, near[j, i], tolerance, weight, total)
                    for k in range(len(sums)):
                        _add(weight, proportions[k, y + j, left + i : left + i + n], sums[k])
            trusted = trust[row, left : left + n]
            for x in range(n):
                told = min(total[x] / np.float32(_ENOUGH), one)
                share[x] = max(one - there[x], zero) * told
                trusted[x] += share[x] * (one - trusted[x])
                total[x] = one / max(total[x], np.float32(1e-30))
            for k in range(3):
                left_over[:] = one
                for lamp in range(lamps):
                    part, found = smooth[lamp, k, row, left : left + n], sums[3 * lamp + k]
                    for x in range(n):
                        mean = found[x] * total[x]
                        left_over[x] -= mean
                        part[x] += share[x] * (mean - part[x])
                part = smooth[lamps, k, row, left : left + n]
                for x in range(n):
                    part[x] += share[x] * (left_over[x] - part[x])


@inlined
def _tolerate(own: Colour, noise: tuple[Numbers, Numbers], tolerance: Any) -> None:
    """Write 1 ÷ the square of the difference at which neighbours count a quarter."""
    a0, a1, a2 = own
    gain, floor = noise
    zero, two = np.float32(0.0), np.float32(2.0)
    r, g, b = np.float32(gain[0]), np.float32(gain[1]), np.float32(gain[2])
    level = np.float32(floor[0] + floor[1] + floor[2])
    for x in range(len(a0)):
        same = a0[x] * a0[x] + a1[x] * a1[x] + a2[x] * a2[x]
        random = r * max(a0[x], zero) + g * max(a1[x], zero) + b * max(a2[x], zero) + level
        allowed = np.float32(_SAME) * same + two * random + np.float32(1e-12)
        tolerance[x] = np.float32(1.0) / allowed


@inlined
def _weigh_alike(
    own: Colour, others: Colour, count: Any, near: Any, tolerance: Any, weight: Any, total: Any
) -> None:
    """Write what neighbours count, and add it to the total."""
    a0, a1, a2 = own
    b0, b1, b2 = others
    one = np.float32(1.0)
    for x in range(len(count)):
        a, b, c = b0[x] - a0[x], b1[x] - a1[x], b2[x] - a2[x]
        unlike = one + tolerance[x] * (a * a + b * b + c * c)
        found = near * count[x] / (unlike * unlike)
        weight[x] = found
        total[x] += found


@inlined
def _add(weight: Any, values: Any, total: Any) -> None:
    """Add values, weighed."""
    for x in range(len(values)):
        total[x] += weight[x] * values[x]
