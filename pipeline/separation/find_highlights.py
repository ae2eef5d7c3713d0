"""Where two lamps, or the flash, are mirrored.

All that a coloured surface gives of two lamps matt lies in a plane, the colours of both lamps
beside it: so highlights are told where there are two.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.compiling import compiled, inlined
from pipeline.images.frames import Colour, Mask, Plane, Planes, planes_of
from pipeline.images.quantiles import weighted_quantile
from pipeline.lamps.lamps import Lamps
from pipeline.light.shares import shares_of_two
from pipeline.pair.reduced import ReducedPair
from pipeline.separation.highlights import Highlights
from pipeline.separation.mirrored_light import (
    KINDS,
    MODEL,
    SHADING,
    TINY,
    TwoLamps,
    explain,
    light_of_two,
    matt_light,
    mirrored_light,
    squared,
)
from pipeline.separation.proportions import pixel, times

_LEAST_SHADING = 0.1  # of both lamps' shares, to which a shadow's are nothing
_MOST_UNUSUAL = 3.0  # shares that are not like those around do not tell a highlight alone
_BRIGHT = 0.85  # quantile of shares around: the brightest that matt light is likely to be
_BRIGHTER = 0.2  # relative: how far matt light goes beyond that
_MOST_BRIGHT = 12.0  # no shadow makes shares brighter, as it makes them unusual
_NOTABLE = 1.2  # times the mean around: with less of either lamp, matt light is believed
_WORTH, _MOST_WORTH = 6.0, 12.0  # of a highlight: the least, and the most of a block
_WORTH_OF_RIM = 1.0
_AGREEING = 5  # blocks across that are to agree
_REACH = 0.047  # of the longer side: where the neighbours lie
_STEPS = 4  # of neighbours on each side
_ALIKE = 0.015  # chromaticity
_UNLIKE = 4.0  # of that: beyond it nothing is alike
_LEAST_ALIKE = 2.0  # blocks of like colour, a block itself among its neighbours


def find_highlights(reduced: ReducedPair, lamps: Lamps, flash_white: Floats64) -> Highlights | None:
    """Find the highlights of two lamps; None where there are none, or not two lamps.

    flash_white: (3,) camera RGB of a white card under the flash. A block is a highlight where
    light of like neighbours in much the same strength and that of one lamp, or without that of the
    flash, explain it much better than matt light of both lamps does, and those around it agree; at
    the rim of such blocks, a little better is enough.
    """
    if len(lamps) != 2:
        return None
    colours = lamps.matrices @ flash_white
    light = light_of_two(lamps, colours)
    seen, flash = planes_of(reduced.no_flash), planes_of(reduced.flash)
    variances = planes_of(reduced.no_flash_variance), planes_of(reduced.flash_variance)
    height, width = reduced.usable.shape
    matt = np.empty((3, height, width), np.float32)
    _fit_matt(seen, flash, *variances, light, matt)
    step = max(round(_REACH * max(height, width) / _STEPS), 1)
    around = np.zeros((2, height, width), np.float32)
    kind, worth = np.full((height, width), -1), np.full((height, width), -_MOST_WORTH, np.float32)
    brighter = np.zeros((height, width), np.float32)
    asked = _unlike_matt(matt, reduced.usable, 2 * _STEPS * step + 1)
    _weigh(seen, flash, reduced.usable, asked, matt, light, step, around, kind, worth, brighter)
    worth += _trust_in_brightness(worth, brighter) * brighter
    np.clip(worth, -_MOST_WORTH, _MOST_WORTH, out=worth)
    found = (kind >= 0) & (cv2.blur(worth, (_AGREEING, _AGREEING)) > _WORTH)
    if not found.any():
        return None
    # at the rim of a highlight half of those around cannot agree
    beside = cv2.dilate(found.astype(np.uint8), np.ones((_AGREEING, _AGREEING), np.uint8)) > 0
    found |= beside & (kind >= 0) & (worth > _WORTH_OF_RIM)
    weights = [(found & (kind == one)).astype(np.float32) for one in range(KINDS)]
    # beside the last blocks of a highlight pixels lie between them and what has no shares
    count = np.maximum(cv2.blur(found.astype(np.float32), (3, 3)), TINY)
    shares = [np.where(found, one, cv2.blur(one * found, (3, 3)) / count) for one in around]
    return Highlights(np.stack([*weights, *shares], axis=2), reduced.block, colours)


@compiled
def _fit_matt(
    no_flash: Planes,
    flash: Planes,
    no_flash_variance: Planes,
    flash_variance: Planes,
    lamps: TwoLamps,
    matt: Floats32,
) -> None:
    """Write shares of both lamps, and what they leave over of the light, relative, less noise."""
    weights, one = lamps.weights, np.float32(1.0)
    for y in range(matt.shape[1]):
        for x in range(matt.shape[2]):
            seen = times(pixel(no_flash, y, x), weights)
            first, second = matt_light(lamps, pixel(flash, y, x), one, one)
            first, second = times(first, weights), times(second, weights)
            z0, z1, scale = shares_of_two(seen, first, second)
            z0, z1 = z0 / scale, z1 / scale
            left = np.float32(0.0)
            for k in range(3):
                off = seen[k] - z0 * first[k] - z1 * second[k]
                variance = no_flash_variance[k][y, x]
                for c in range(3):
                    i = 3 * k + c
                    mixed = z0 * lamps.matrices[0][i] + z1 * lamps.matrices[1][i]
                    variance += mixed * mixed * flash_variance[c][y, x]
                left += off * off - weights[k] * weights[k] * variance
            whole = max(squared(seen), TINY)
            matt[0, y, x], matt[1, y, x] = z0, z1
            matt[2, y, x] = np.sqrt(max(left, np.float32(0.0)) / whole)


def _unlike_matt(matt: Floats32, usable: Mask, side: int) -> Mask:
    """Blocks worth a look: matt light leaves something over, or is brighter than the mean around.

    matt: as _fit_matt writes it. side: of what is around, in blocks.
    """
    count = np.maximum(cv2.blur(usable.astype(np.float32), (side, side)), TINY)
    unlike: Mask = matt[2] > MODEL
    for one in matt[:2]:
        unlike |= one > _NOTABLE / count * cv2.blur(one * usable, (side, side))
    return unlike & usable


def _trust_in_brightness(worth: Floats32, brighter: Floats32) -> float:
    """Share of what is brighter than all around that colour tells to be a highlight, 0…1.

    The rest is matt by its colour: sunlight through leaves or blinds, or a lamp that throws a
    pattern, and brightness tells nothing in such a picture. 1 where colour tells nothing.

    worth, brighter: (h, w) of blocks, as _weigh writes them.
    """
    bright = brighter > _MOST_BRIGHT / 2
    mirrored, matt = (bright & (one > _WORTH) for one in (worth, -worth))
    told = np.count_nonzero(mirrored) + np.count_nonzero(matt)
    return np.count_nonzero(mirrored) / told if told else 1.0


@compiled
def _weigh(
    no_flash: Planes,
    flash: Planes,
    usable: Mask,
    asked: Mask,
    matt: Floats32,
    lamps: TwoLamps,
    step: int,
    around: Floats32,
    kind: NDArray[np.int64],
    worth: Plane,
    brighter: Plane,
) -> None:
    """Write of the blocks asked for what neighbours have, which highlight it would be, its worth.

    The worth is how much further from the light matt light is, squared, in units of MODEL;
    brighter is what it counts besides that matt light is brighter than around.
    """
    most = (2 * _STEPS + 1) ** 2
    shares, like = np.empty((2, most), np.float32), np.empty(most, np.float32)
    for y in range(usable.shape[0]):
        for x in range(usable.shape[1]):
            if not asked[y, x]:
                continue
            count = _neighbours(flash, usable, matt, y, x, step, shares, like)
            if like[:count].sum() < _LEAST_ALIKE:
                continue
            s0, bright0 = _usual(shares[0, :count], like[:count])
            s1, bright1 = _usual(shares[1, :count], like[:count])
            around[0, y, x], around[1, y, x] = s0, s1
            seen = pixel(no_flash, y, x)
            first, second = matt_light(lamps, pixel(flash, y, x), s0, s1)
            least = np.inf
            for one in range(KINDS):
                cost = _cost_of_mirrored(
                    lamps, one, seen, (first, second), (s0, s1), (bright0, bright1)
                )
                if cost < least:
                    least, kind[y, x] = cost, one
            z0, z1 = matt[0, y, x], matt[1, y, x]
            brighter[y, x] = _cost_of_brightness(z0, z1, bright0, bright1)
            if kind[y, x] >= 0:
                cost = (matt[2, y, x] / MODEL) ** 2 + _cost_of_shares(z0, z1, s0, s1)
                worth[y, x] = max(cost - least, -2 * _MOST_WORTH)


@inlined
def _cost_of_shares(z0: Any, z1: Any, s0: Any, s1: Any) -> Any:
    """What it counts that shares z are unlike those around, s: shadows and edges do that, too."""
    shading = _LEAST_SHADING * (s0 + s1) + TINY
    off = ((z0 - s0) / (s0 + shading)) ** 2 + ((z1 - s1) / (s1 + shading)) ** 2
    return _bounded(off / SHADING**2, _MOST_UNUSUAL)


@inlined
def _cost_of_brightness(z0: Any, z1: Any, bright0: Any, bright1: Any) -> Any:
    """What it counts that a lamp's share is beyond the brightest around."""
    shading = _LEAST_SHADING * (bright0 + bright1) + TINY
    off = max((z0 - bright0) / (bright0 + shading), 0.0) ** 2
    off += max((z1 - bright1) / (bright1 + shading), 0.0) ** 2
    return _bounded(off / _BRIGHTER**2, _MOST_BRIGHT)


@inlined
def _cost_of_mirrored(
    lamps: TwoLamps,
    kind: int,
    seen: Colour,
    around: tuple[Colour, Colour],
    shares: tuple[Any, Any],
    bright: tuple[Any, Any],
) -> Any:
    """How far light is from a highlight of that kind; infinite where nothing is mirrored.

    around: matt light of the lamps with the shares around. bright: the brightest of these, beyond
    which the matt light beneath a highlight is no likelier than matt light alone.
    """
    (first, second), (s0, s1) = around, shares
    mirrored = mirrored_light(lamps.colours, kind, s0, s1)
    a, b = explain(seen, first, second, mirrored, lamps.weights)
    left = 0.0
    for k in range(3):
        off = seen[k] - a * (first[k] + second[k]) - b * mirrored[k]
        left += (off * lamps.weights[k]) ** 2
    whole = max(squared(times(seen, lamps.weights)), TINY)
    cost = left / whole / MODEL**2 + _bounded(((a - 1.0) / SHADING) ** 2, _MOST_UNUSUAL)
    cost += _cost_of_brightness(a * s0, a * s1, bright[0], bright[1])
    return cost if b > 0 else np.inf


@compiled
def _neighbours(
    flash: Planes,
    usable: Mask,
    matt: Floats32,
    y: int,
    x: int,
    step: int,
    shares: Floats32,
    like: Floats32,
) -> int:
    """Write shares of usable blocks of like colour around one, itself among them, and how like.

    Returns how many they are.
    """
    own, count, reach = _chromaticity(pixel(flash, y, x)), 0, _STEPS * step
    for i in range(max(y - reach, y % step), min(y + reach + 1, usable.shape[0]), step):
        for j in range(max(x - reach, x % step), min(x + reach + 1, usable.shape[1]), step):
            if usable[i, j]:
                other = _chromaticity(pixel(flash, i, j))
                off = ((other[0] - own[0]) ** 2 + (other[1] - own[1]) ** 2) / _ALIKE**2
                if off < _UNLIKE**2:
                    like[count] = np.exp(-0.5 * off)
                    shares[0, count], shares[1, count] = matt[0, i, j], matt[1, i, j]
                    count += 1
    return count


@inlined
def _bounded(squared: Any, most: float) -> Any:
    """The square where it is small, at most so much where it is large (Geman and McClure 1985)."""
    return most * squared / (most + squared)


@inlined
def _usual(values: Floats32, weights: Floats32) -> tuple[float, float]:
    """Weighted median, and the quantile that _BRIGHT is."""
    return weighted_quantile(values, weights, 0.5), weighted_quantile(values, weights, _BRIGHT)


@inlined
def _chromaticity(f: Colour) -> tuple[Any, Any]:
    total = max(f[0] + f[1] + f[2], TINY)
    return f[0] / total, f[1] / total
