"""Finds by how much a camera balanced the white of the flash photograph otherwise, from the pair.

Where two places of one surface have the same colour in the light of the flash alone, whatever
lamps light them, the flash part, what the flash photograph has more than the other, has one colour
as well. Through wrong gains of red and blue it has not, by the more the more of what the flash
photograph shows is the lamps' in one place than in the other. So the gains are those by which the
most pairs of neighbours that differ in this have flash parts of one colour.

The difference of two flash parts' colours has a peak at 0 by places of one surface and a broad rest
by those of two. What is looked for is the height of the peak above its surroundings, as for a
camera's contrast (find_tone_curve). How bright the flash part is does not count: it falls off with
distance and as surfaces turn. So the exposures must be known.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats, Floats64
from pipeline.colour.curves import linear_to_srgb
from pipeline.compiling import summing
from pipeline.images.area_means import area_means
from pipeline.images.blocks import any_in_blocks, blocks_within
from pipeline.images.frames import Mask, Photograph
from pipeline.pair.balance_change import TO_SENSOR, BalanceChange
from pipeline.pair.find_tone_curve import usual_contrasts
from pipeline.pair.tone_curve import ToneCurve

# Chosen on development rooms (docs/trials/renderings.md)
_LONG_SIDE = 384
_OFFSETS = (
    *((0, 4), (4, 0), (0, 10), (10, 0), (8, 8), (8, -8)),
    *((0, 24), (24, 0), (20, 20), (20, -20)),
)
"""(rows, columns) in blocks from a place to its neighbours."""
_MOST_PAIRS, _FEW_PAIRS = 10_000, 1_000
_ROUGH_PAIRS = 1_500
_CODES = (0.05, 0.985)  # code values between which blocks tell
_LEAST_LIGHT = 1e-3  # of white
_LEAST_FLASH = 2e-3
_LEAST_APART = 0.1  # of the lamps' share of the flash photograph
_CODE_NOISE, _CODE_POWER = 0.005, 2.2  # of code values; of light over them, about
_WIDTHS = ((0.12, 0.3), (0.06, 0.15), (0.03, 0.08))
_GRID = np.linspace(-0.6, 0.6, 9)  # natural logarithms of gains
_WAYS = [np.array(way) for way in product((-1, 0, 1), repeat=2) if any(way)]
_FIRST_STEP, _LAST_STEP = 0.5, 0.003  # in widths of a bell; of logarithms
_FOLLOWED = 2
_MOST_GAIN = 0.65
_FEW_KNOWN = 0.05  # of the pairs, where the flash part is positive
_SURE, _LEAST_HEIGHT = 2.0, 1.0  # times the height without gains; % of the pairs
_LEAST_GAIN = 0.07
_FAR_HIGHER, _ABOUT_AS_HIGH = 1.3, 0.9  # times the height without a contrast


@dataclass(frozen=True)
class _Neighbours:
    """Pairs of blocks that may show one surface under other light.

    light, variances: (4, n, 3), RGB of a sensor: without the flash in either place, with it in
    either, in exposures of the first.
    """

    light: Floats64
    variances: Floats64

    def some(self, most: int) -> _Neighbours:
        """At most so many of them, from everywhere."""
        which = _spread(self.light.shape[1], most)
        return _Neighbours(*(one.take(which, axis=1) for one in (self.light, self.variances)))


def find_balance_change(
    no_flash: Photograph, flash: Photograph, unusable: Mask, ratio: float
) -> BalanceChange | None:
    """The gains without which the flash's light has one colour in the most places.

    None where there are too few places to tell, where equal balances or a contrast explain nearly
    as much, or where no more differs than is found between photographs of one balance.

    Parameters
    ----------
    no_flash, flash : (H, W, 3), linear sRGB, 1.0 = white, aligned, the flash photograph with the
        lamps' light in it
    unusable : (H, W), what tells nothing of light
    ratio : of the exposures, flash photograph ÷ other
    """
    srgb = _places(no_flash, flash, unusable, ratio)
    if srgb is None:
        return None
    curves = sorted(usual_contrasts(), key=lambda curve: bool(curve.logs.any()))  # none comes first
    seen = [_seen(curve.light(srgb), ratio) for curve in curves]
    logs, height = _best(seen)
    alike = max(_height(one, np.zeros(2), _WIDTHS[-1]) for one in seen)
    differ = _LEAST_GAIN < np.abs(logs).max() < _MOST_GAIN
    if not differ or height < max(_LEAST_HEIGHT, _SURE * alike):
        return None
    return _gains(logs)


def settle_balance_change(
    no_flash: Photograph,
    flash: Photograph,
    unusable: Mask,
    ratio: float,
    start: BalanceChange,
    tone: ToneCurve | None,
) -> tuple[BalanceChange, ToneCurve | None]:
    """The gains near those found, as light is through a contrast, and the contrast.

    None for the contrast where the flash's light has one colour in more places without it. The
    other parameters are those of find_balance_change.
    """
    srgb = _places(no_flash, flash, unusable, ratio)
    if srgb is None:
        return start, tone
    height, logs = _followed(_seen(srgb, ratio), start)
    if tone is not None:
        toned, others = _followed(_seen(tone.light(srgb), ratio), start)
        if toned > _ABOUT_AS_HIGH * height:
            return _gains(others), tone
    return _gains(logs), None


def _followed(neighbours: _Neighbours, start: BalanceChange) -> tuple[float, Floats64]:
    logs = _climbed(neighbours, np.log((start.red, start.blue)))
    return _height(neighbours, logs, _WIDTHS[-1]), logs


def _gains(logs: Floats64) -> BalanceChange:
    return BalanceChange(*(float(gain) for gain in np.exp(logs)))


def _places(
    no_flash: Photograph, flash: Photograph, unusable: Mask, ratio: float
) -> Floats64 | None:
    """Linear sRGB (4, n, 3) of pairs of blocks as in _Neighbours; None where there are too few."""
    height, width = unusable.shape
    blocks = blocks_within(width, height, _LONG_SIDE)
    means = (area_means(image, blocks.size, blocks.crop) for image in (no_flash, flash))
    both = np.clip(np.stack([*means]), 0.0, 1.0).astype(np.float64)
    codes = linear_to_srgb(both)
    known = ~any_in_blocks(unusable, blocks.side)
    known &= (codes.min(axis=(0, 3)) > _CODES[0]) & (codes.max(axis=(0, 3)) < _CODES[1])
    light = both @ TO_SENSOR.T
    known &= light.min(axis=(0, 3)) > _LEAST_LIGHT
    lamps = light[0] * ratio / np.maximum(light[1], _LEAST_LIGHT)
    numbers = np.arange(known.size).reshape(known.shape)
    found = []
    for down, across in _OFFSETS:
        one = slice(0, max(len(known) - down, 0)), slice(max(-across, 0), None)
        other = slice(down, None), slice(max(across, 0), None)
        columns = max(known.shape[1] - abs(across), 0)
        first, second = numbers[one][:, :columns], numbers[other][:, :columns]
        apart = np.abs(lamps[one][:, :columns] - lamps[other][:, :columns]).max(axis=2)
        there = known[one][:, :columns] & known[other][:, :columns] & (apart > _LEAST_APART)
        found.append(np.stack([first[there], second[there]]))
    pairs = np.concatenate(found, axis=1)
    if pairs.shape[1] < _FEW_PAIRS:
        return None
    pairs = pairs[:, _spread(pairs.shape[1], _MOST_PAIRS)]
    return both.reshape(2, -1, 3).take(pairs, axis=1).reshape(4, -1, 3)


def _spread(count: int, most: int) -> NDArray[np.int_]:
    return np.linspace(0, count - 1, min(count, most)).astype(int)


def _seen(srgb: Floats, ratio: float) -> _Neighbours:
    """What a sensor saw of light (4, n, 3), and the variances of code values' noise."""
    light = srgb.astype(np.float64)
    noise = light * (_CODE_POWER * _CODE_NOISE) / linear_to_srgb(np.clip(light, 1e-4, 1.0))
    scale = np.array((1.0, 1.0, ratio, ratio))[:, None, None]
    seen, variances = light @ TO_SENSOR.T, np.square(noise) @ np.square(TO_SENSOR).T
    return _Neighbours(seen / scale, variances / np.square(scale))


def _best(seen: list[_Neighbours]) -> tuple[Floats64, float]:
    """Logarithms (2,) of the gains of red and blue with the highest peak, and its height.

    seen: the same pairs through several curves, the first of which is taken unless another has a
    far higher peak. Both are 0 where the peak is highest without gains even before it is followed.
    """
    few = [one.some(_ROUGH_PAIRS) for one in seen]
    grid = [np.array(logs) for logs in product(_GRID, _GRID)]
    starts = [
        (_height(one, logs, _WIDTHS[0]), which, place)
        for which, one in enumerate(few)
        for place, logs in enumerate(grid)
    ]
    starts.sort(reverse=True)
    if not grid[starts[0][2]].any():
        return np.zeros(2), 0.0  # most of all where there is none: saves half
    first = next(start for start in starts if start[1] == 0)
    found = []
    for _, which, place in (first, *starts[:_FOLLOWED]):
        logs = _climbed(seen[which], grid[place])
        found.append((_height(seen[which], logs, _WIDTHS[-1]), logs))
    best = max(found, key=lambda one: one[0])
    height, logs = best if best[0] > _FAR_HIGHER * found[0][0] else found[0]
    return logs, height


def _climbed(neighbours: _Neighbours, logs: Floats64) -> Floats64:
    """Up the height of the peak in ever smaller steps, through bells ever narrower."""
    for widths in _WIDTHS:
        height, step = _height(neighbours, logs, widths), _FIRST_STEP * widths[0]
        while step > _LAST_STEP:
            around = [np.clip(logs + step * way, -_MOST_GAIN, _MOST_GAIN) for way in _WAYS]
            heights = [_height(neighbours, one, widths) for one in around]
            best = int(np.argmax(heights))
            if heights[best] > height:
                height, logs = heights[best], around[best]
            else:
                step /= 2
    return logs


def _height(neighbours: _Neighbours, logs: Floats64, widths: tuple[float, float]) -> float:
    """Height of the peak above its surroundings without gains of red and blue, in %."""
    less = float(np.exp(-logs[0])), 1.0, float(np.exp(-logs[1]))
    peak, weight = _peak(neighbours.light, neighbours.variances, less, *widths)
    return float(100 * peak / max(weight, _FEW_KNOWN * neighbours.light.shape[1]))


@summing
def _peak(
    light: Floats64,
    variances: Floats64,
    less: tuple[float, float, float],
    narrow: float,
    wide: float,
) -> tuple[float, float]:
    """Sums over pairs, as in _Neighbours: the peak above its surroundings, and the weights."""
    peak = total = 0.0
    parts = np.empty((2, 3))
    for i in range(light.shape[1]):
        noise, known = 0.0, True
        for place in range(2):
            for c in range(3):
                part = light[2 + place, i, c] * less[c] - light[place, i, c]
                known &= part > _LEAST_FLASH
                part = max(part, _LEAST_FLASH)
                variance = variances[place, i, c] + variances[2 + place, i, c] * less[c] ** 2
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
