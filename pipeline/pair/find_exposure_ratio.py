"""Finds the ratio of the exposures from the colours of a linear pair.

Where the flash photograph is brought on the other's scale by a wrong ratio, some of the lamps'
light stays in the flash part, or too much is taken off it. Then the flash part has another colour
wherever a surface has another share of the lamps' light, and by the right ratio it has one colour
on one surface (one_surface). No place without flash is needed.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.blocks import sums_of_blocks
from pipeline.images.frames import Mask
from pipeline.pair.one_surface import Seen, pairs_apart
from pipeline.pair.ratios import Ratios

# Chosen on development scenes (docs/trials/exposure_ratio.md)
LONG_SIDE = 64  # blocks: noise and code values count for more than small surfaces
OFFSETS = (
    *((0, 1), (1, 0), (0, 2), (2, 0), (1, 1), (1, -1)),
    *((0, 4), (4, 0), (3, 3), (3, -3)),
)
_FEW_PAIRS = 300
_DEVIATION = 0.01  # of a block's light; more than noise, for a surface is not quite of one colour
_WIDTHS = ((0.06, 0.15), (0.03, 0.08))
_BRIGHT = 0.9  # quantile of the flash photograph's values that is taken for white
_LEAST_RATIO = 0.02  # quantile of the blocks' ratios, about the greatest ratio that may be
_LEAST_SPREAD = 0.1  # natural logarithm, of the median over that: else the flash part is noise
BELOW, _ABOVE, _STEP = 2.5, 0.3, 0.1  # natural logarithms, from there
_LAST_STEP = 0.002
LEAST_HEIGHT, _SURE = 2.0, 1.5  # % of the pairs; times the height at the ratio that was told
_CLOSE = 0.06  # natural logarithm


def find_exposure_ratio(ratios: Ratios) -> float | None:
    """The factor > 0 by which the ratio must be multiplied that the pair was brought to scale by.

    1.0 where that ratio is right, None where little tells: where the lamps' share is alike
    everywhere, their colour that of the flash, or the flash weak. ratios: of a linear pair, not of
    a rendered one.
    """
    seen = light_of_pairs(ratios)
    if seen is None:
        return None
    light, most = seen
    lowest = float(np.log(most)) - BELOW
    found, height = highest_peak(light, float(np.log(most)))
    if height < max(LEAST_HEIGHT, _SURE * height_of(light, lowest)):
        return None
    if abs(found) < _CLOSE:
        return 1.0
    return float(np.exp(found)) if height > _SURE * height_of(light, 0.0) else None


def light_of_pairs(ratios: Ratios) -> tuple[Floats64, float] | None:
    """Light (4, n, 3) of pairs of places, as of Seen, and about the greatest ratio that may be.

    None where little tells, as of find_exposure_ratio. The light is relative to bright places.
    """
    return pairs_that_tell(*larger_blocks(ratios))


def pairs_that_tell(
    no_flash: Floats64, flash: Floats64, known: Mask
) -> tuple[Floats64, float] | None:
    """As light_of_pairs, of larger blocks as larger_blocks makes them."""
    if not known.any():
        return None
    quotients = flash / no_flash
    least = quotients[known].min(axis=1)
    most = float(np.quantile(least, _LEAST_RATIO))
    if np.median(least) < np.exp(_LEAST_SPREAD) * most:
        return None
    pairs = pairs_apart(most / quotients, known, OFFSETS, _FEW_PAIRS)
    if pairs is None:
        return None
    light = np.stack([no_flash.reshape(-1, 3), flash.reshape(-1, 3)]).take(pairs, axis=1)
    return light.reshape(4, -1, 3) / np.quantile(flash[known], _BRIGHT), most


def height_of(light: Floats64, log: float) -> float:
    """Height of the peak, in % of the pairs, by a ratio whose natural logarithm is given.

    light: of light_of_pairs.
    """
    return _height(light, log, _WIDTHS[-1])


def larger_blocks(ratios: Ratios) -> tuple[Floats64, Floats64, Mask]:
    """Both photographs (h, w, 3) > 0 in larger blocks, and which tell: half of each is usable."""
    flash = ratios.no_flash * np.exp(ratios.logs)
    return means_of_usable(ratios.no_flash, flash, ratios.usable)


def means_of_usable(
    no_flash: Floats64, flash: Floats64, usable: Mask
) -> tuple[Floats64, Floats64, Mask]:
    """As larger_blocks, of smaller blocks (h, w, 3) of which some (h, w) are usable."""
    side = -(-max(usable.shape) // LONG_SIDE)
    counted = usable[..., None].astype(np.float64)
    count = sums_of_blocks(counted, side)
    means = [
        sums_of_blocks(each * counted, side) / np.maximum(count, 1.0) for each in (no_flash, flash)
    ]
    known = np.asarray(count[..., 0] >= side**2 / 2)
    first, second = (np.where(known[..., None], mean, 1.0) for mean in means)
    return first, second, known


def highest_peak(light: Floats64, most: float) -> tuple[float, float]:
    """Natural logarithm of the ratio with the highest peak, and its height.

    light: (4, n, 3), as of Seen. most: logarithm of about the greatest ratio. The height is 0 where
    the peak is highest at an end, as the lamps' own light in few colours makes it.
    """
    grid = np.arange(most - BELOW, most + _ABOVE, _STEP)
    place = int(np.argmax([_height(light, float(log), _WIDTHS[0]) for log in grid]))
    if place in (0, len(grid) - 1):
        return 0.0, 0.0
    log, step = float(grid[place]), _STEP / 2
    height = _height(light, log, _WIDTHS[-1])
    while step > _LAST_STEP:
        around = [(_height(light, near, _WIDTHS[-1]), near) for near in (log - step, log + step)]
        if max(around)[0] > height:
            height, log = max(around)
        else:
            step /= 2
    return log, height


def _height(light: Floats64, log: float, widths: tuple[float, float]) -> float:
    """Of the peak with the flash photograph brought to scale by the logarithm of a ratio."""
    scaled = light * np.array((1.0, 1.0, np.exp(-log), np.exp(-log)))[:, None, None]
    return Seen(scaled, np.square(_DEVIATION * scaled)).height(np.zeros(2), widths)
