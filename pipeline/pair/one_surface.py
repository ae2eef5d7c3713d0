"""Pairs of places that may show one surface, and in how many the flash's light has one colour.

Where two places of one surface have the same colour in the light of the flash alone, whatever
lamps light them, the flash part, what the flash photograph has more than the other, has one colour
as well. Through a wrong curve, or wrong gains of red and blue, it has not, by the more the more of
what the flash photograph shows is the lamps' in one place than in the other.

The difference of two flash parts' colours has a peak at 0 by places of one surface and a broad rest
by those of two. A mean would be drawn towards the rest, so what is told is the height of the peak
above its surroundings: of a narrow bell less a wide one of the same volume, which says nothing of a
rest that rises evenly. A curve that takes the colour out of all things makes a peak as well, but
one of strangers, too, places put together by chance. How bright the flash part is does not count:
it falls off with distance and as surfaces turn. A wrong ratio of the exposures looks like a curve
or gains: these are looked for where it is known, and it is where there are none of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.colour.curves import linear_to_srgb
from pipeline.compiling import summing
from pipeline.images.area_means import area_means
from pipeline.images.blocks import any_in_blocks, blocks_within
from pipeline.images.frames import Mask, Photograph
from pipeline.pair.balance_change import TO_SENSOR
from pipeline.pair.tone_curve import ToneCurve

# Chosen on development rooms (docs/trials/renderings.md)
_LONG_SIDE = 384
_OFFSETS = (
    *((0, 4), (4, 0), (0, 10), (10, 0), (8, 8), (8, -8)),
    *((0, 24), (24, 0), (20, 20), (20, -20)),
)
"""(rows, columns) in blocks from a place to its neighbours."""
_MOST_PAIRS, _FEW_PAIRS = 10_000, 1_000
_CODES = (0.05, 0.985)  # code values between which blocks tell
LEAST_LIGHT = 1e-3
"""Of white, that a block must have to tell colours."""
_LEAST_FLASH = 2e-3
_LEAST_APART = 0.1  # of the lamps' share of the flash photograph
_CODE_NOISE, _CODE_POWER = 0.005, 2.2  # of code values; of light over them, about
_FEW_KNOWN = 0.05  # of the pairs, where the flash part is positive


Widths = tuple[float, float]
"""Of a narrow bell and a wide one, in natural logarithms of colour."""


@dataclass(frozen=True)
class FlashParts:
    """What the flash photograph has more than the other, in pairs of blocks.

    light: (2, n, 3) > 0, RGB of a sensor. noise: (n,), the sum of variances of its logarithms.
    known: bool (n,), where none of it was as good as 0.
    """

    light: Floats64
    noise: Floats64
    known: Mask

    def weights(self, width: float) -> Floats64:
        """Of pairs (n,) in a bell of a width: lower where noise is more than it is wide."""
        return np.asarray(self.known / (1.0 + 0.75 * self.noise / width**2))


@dataclass(frozen=True)
class Seen:
    """What a sensor saw of pairs of blocks.

    light, variances: (4, n, 3), RGB of a sensor: without the flash in either place, with it in
    either, in exposures of the first.
    """

    light: Floats64
    variances: Floats64

    def height(self, gains: Floats64, widths: Widths) -> float:
        """Height of the peak above its surroundings in % of the pairs.

        gains: (2,), natural logarithms of those of red and blue, taken off the flash photograph.
        """
        return self._height(gains, widths, 0)

    def excess(self, gains: Floats64, widths: Widths) -> float:
        """By how much that is more than for strangers, places put together by chance."""
        return self.height(gains, widths) - self._height(gains, widths, self.light.shape[1] // 3)

    def _height(self, gains: Floats64, widths: Widths, away: int) -> float:
        less = taken_off(gains)
        peak, weight = _peak(self.light, self.variances, less, *widths, away)
        return float(100 * peak / max(weight, _FEW_KNOWN * self.light.shape[1]))

    def brightened(self, logs: Floats64) -> Seen:
        """With the flash photograph multiplied by so much; natural logarithms (2, n)."""
        factors = np.ones(self.light.shape[:2])
        factors[2:] = np.exp(logs)
        factors = factors[..., None]
        return Seen(self.light * factors, self.variances * np.square(factors))

    def flash_parts(self, gains: Floats64) -> FlashParts:
        """The flash parts without gains (2,) of the flash photograph."""
        less = taken_off(gains)
        light = self.light[2:] * less - self.light[:2]
        known = np.asarray((light > _LEAST_FLASH).all(axis=(0, 2)))
        light = np.maximum(light, _LEAST_FLASH)
        variances = self.variances[:2] + self.variances[2:] * np.square(less)
        return FlashParts(light, (variances / np.square(light)).sum(axis=(0, 2)), known)


@dataclass(frozen=True)
class PairBlocks:
    """Blocks of a pair that a camera rendered, at most 384 to a side.

    srgb: (2, h, w, 3), 0…1, linear by sRGB's curve, 1.0 = white: without the flash, with it. known:
    bool (h, w), all of their pixels tell of light. side: of a block, in pixels.
    """

    srgb: Floats64
    known: Mask
    side: int

    @cached_property
    def telling(self) -> Mask:
        """Known blocks (h, w) that are neither dark nor near white in either photograph."""
        codes = linear_to_srgb(self.srgb)
        dark = codes.min(axis=(0, 3)) <= _CODES[0]
        return np.asarray(self.known & ~dark & (codes.max(axis=(0, 3)) < _CODES[1]))


@dataclass(frozen=True)
class Neighbours:
    """Pairs of blocks that may show one surface under other light.

    srgb: (4, n, 3), linear by sRGB's curve, 1.0 = white: without the flash in either place, with it
    in either. ratio: of the exposures, flash photograph ÷ other. numbers: (2, n) of the blocks, row
    by row. brightened: (2, n), natural logarithms of what the flash photograph is multiplied by
    beside that ratio.
    """

    srgb: Floats64
    ratio: float
    numbers: NDArray[np.int_]
    brightened: Floats64

    def some(self, most: int) -> Neighbours:
        """At most so many of them, from everywhere."""
        return self.those(_spread(self.srgb.shape[1], most))

    def those(self, which: NDArray[np.int_] | Mask) -> Neighbours:
        """Some of them, by their numbers or as marked, bool (n,)."""
        return Neighbours(
            self.srgb[:, which], self.ratio, self.numbers[:, which], self.brightened[:, which]
        )

    def brightened_by(self, logs: Floats64) -> Neighbours:
        """With the flash photograph multiplied by so much; natural logarithms (h, w) of blocks."""
        return replace(self, brightened=logs.ravel().take(self.numbers))

    @cached_property
    def codes(self) -> Floats64:
        """Code values (4, n, 3), 0…1."""
        return np.asarray(linear_to_srgb(np.clip(self.srgb, 1e-4, 1.0)))

    def light(self, curve: ToneCurve) -> Floats64:
        """Linear sRGB (4, n, 3) in exposures of the first photograph, without a contrast."""
        scale = np.ones(self.srgb.shape[:2])
        scale[2:] = np.exp(self.brightened) / self.ratio
        return np.asarray(curve.light(self.srgb) * scale[..., None])

    def through(self, curve: ToneCurve) -> Seen:
        """What the sensor saw, if a camera put that contrast on top of sRGB's curve."""
        light = self.light(curve)
        noise = light * (_CODE_POWER * _CODE_NOISE) / self.codes
        return Seen(light @ TO_SENSOR.T, np.square(noise) @ np.square(TO_SENSOR).T)


def average_pair(no_flash: Photograph, flash: Photograph, unusable: Mask) -> PairBlocks:
    """Average a pair in blocks.

    Parameters
    ----------
    no_flash, flash : (H, W, 3), linear by sRGB's curve, 1.0 = white, aligned, the flash photograph
        with the lamps' light in it
    unusable : (H, W), what tells nothing of light
    """
    height, width = unusable.shape
    blocks = blocks_within(width, height, _LONG_SIDE)
    means = (area_means(image, blocks.size, blocks.crop) for image in (no_flash, flash))
    both = np.clip(np.stack([*means]), 0.0, 1.0).astype(np.float64)
    return PairBlocks(both, ~any_in_blocks(unusable, blocks.side), blocks.side)


def find_neighbours(blocks: PairBlocks, ratio: float) -> Neighbours | None:
    """Pairs of blocks in which the lamps' share of the flash photograph differs.

    None where there are too few to tell anything. ratio: of the exposures, flash photograph ÷
    other.
    """
    light = blocks.srgb @ TO_SENSOR.T
    known = blocks.telling & (light.min(axis=(0, 3)) > LEAST_LIGHT)
    lamps = light[0] * ratio / np.maximum(light[1], LEAST_LIGHT)
    pairs = pairs_apart(lamps, known, _OFFSETS, _FEW_PAIRS)
    if pairs is None:
        return None
    srgb = blocks.srgb.reshape(2, -1, 3).take(pairs, axis=1).reshape(4, -1, 3)
    return Neighbours(srgb, ratio, pairs, np.zeros(pairs.shape))


def pairs_apart(
    lamps: Floats64, known: Mask, offsets: Sequence[tuple[int, int]], few: int
) -> NDArray[np.int_] | None:
    """Numbers (2, n) of neighbouring blocks, row by row, in which the lamps' share differs.

    None where there are fewer than `few`; not all where there are very many.

    Parameters
    ----------
    lamps : (h, w, 3), the lamps' share of the flash photograph, of the most there is
    known : bool (h, w), blocks that tell of light
    offsets : (rows ≥ 0, columns) in blocks from a block to its neighbours
    """
    numbers = np.arange(known.size).reshape(known.shape)
    found = []
    for down, across in offsets:
        one = slice(0, max(len(known) - down, 0)), slice(max(-across, 0), None)
        other = slice(down, None), slice(max(across, 0), None)
        columns = max(known.shape[1] - abs(across), 0)
        first, second = numbers[one][:, :columns], numbers[other][:, :columns]
        apart = np.abs(lamps[one][:, :columns] - lamps[other][:, :columns]).max(axis=2)
        there = known[one][:, :columns] & known[other][:, :columns] & (apart > _LEAST_APART)
        found.append(np.stack([first[there], second[there]]))
    pairs = np.concatenate(found, axis=1)
    return pairs[:, _spread(pairs.shape[1], _MOST_PAIRS)] if pairs.shape[1] >= few else None


def _spread(count: int, most: int) -> NDArray[np.int_]:
    return np.linspace(0, count - 1, min(count, most)).astype(int)


def taken_off(gains: Floats64) -> Floats64:
    """What red, green and blue (3,) are multiplied by to take gains (2,), logarithms, off."""
    return np.exp(-np.insert(gains, 1, 0.0))


@summing
def _peak(
    light: Floats64, variances: Floats64, less: Floats64, narrow: float, wide: float, away: int
) -> tuple[float, float]:
    """Sums over pairs, as in Seen: the peak above its surroundings, and the weights.

    away: how much further down the list the second place of a pair is taken from.
    """
    peak = total = 0.0
    parts = np.empty((2, 3))
    for i in range(light.shape[1]):
        noise, known = 0.0, True
        for place in range(2):
            j = (i + place * away) % light.shape[1]
            for c in range(3):
                part = light[2 + place, j, c] * less[c] - light[place, j, c]
                known &= part > _LEAST_FLASH
                part = max(part, _LEAST_FLASH)
                variance = variances[place, j, c] + variances[2 + place, j, c] * less[c] ** 2
                noise += variance / part**2
                parts[place, c] = part
        if known:
            green = parts[1, 1] / parts[0, 1]
            red = np.log(parts[0, 0] / parts[1, 0] * green)
            blue = np.log(parts[0, 2] / parts[1, 2] * green)
            squared = red * red + blue * blue
            surroundings = (narrow / wide) ** 2 * np.exp(-0.5 * squared / wide**2)
            weight = 1.0 / (1.0 + 0.75 * noise / narrow**2)
            peak += weight * (np.exp(-0.5 * squared / narrow**2) - surroundings)
            total += weight
    return peak, total
