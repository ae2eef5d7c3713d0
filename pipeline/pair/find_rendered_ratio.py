"""Finds the ratio of the exposures of a pair that a camera rendered, where nobody knows it.

As find_exposure_ratio, by the colour of the flash's light, but through each usual contrast: a
contrast that is left looks like a ratio, and both are told by the same peak. A white balance that
differs looks like one as well, mostly one above 1, which is not taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Mask
from pipeline.pair.balance_change import TO_SENSOR
from pipeline.pair.find_balance_change import find_balance_change
from pipeline.pair.find_exposure_ratio import (
    BELOW,
    height_of,
    highest_peak,
    means_of_usable,
    pairs_that_tell,
)
from pipeline.pair.find_tone_curve import usual_contrasts
from pipeline.pair.one_surface import LEAST_LIGHT, PairBlocks, find_neighbours
from pipeline.pair.tone_curve import NO_CONTRAST, ToneCurve

# Chosen on development rooms (docs/trials/exposure_ratio.md)
_STEEPEST = 1.0  # S, as for local tone mapping: a steeper one takes the colour out of all things
_PAIRS = 2_000
_LESS_CONTRAST = 0.3  # natural logarithm that a peak through a contrast counts less by
_SURE = 1.5  # times the height with equal exposures, and that of the flash photograph itself
_LEAST_HEIGHT = 3.0  # % of the pairs; what compression leaves reaches 2.6
_WIDTHS = (0.03, 0.08)
_ABOUT_AS_HIGH = 0.8  # of that height by a balance that differs, and the ratio is not taken
_SHORTER = 0.94  # cameras expose the flash photograph shorter; a balance that differs looks longer


def find_rendered_ratio(blocks: PairBlocks) -> float | None:
    """Exposure of the flash photograph ÷ that of the other, below 1.

    None where equal exposures do about as well, where colours tell nothing, and where the flash
    photograph seems to have been exposed longer, as one that was balanced otherwise does.
    """
    no_flash, flash, known = means_of_usable(blocks.srgb[0], blocks.srgb[1], blocks.telling)
    srgb = np.stack([no_flash, flash])
    peaks = [_peak(srgb, known, curve) for curve in usual_contrasts(_STEEPEST)]
    found = [peak for peak in peaks if peak is not None]
    if not found:
        return None
    best = max(found, key=lambda peak: peak.height)
    equal = max(peak.equal for peak in found)
    if best.height < max(_LEAST_HEIGHT, _SURE * max(equal, best.itself)):
        return None
    ratio = float(np.exp(best.log))
    return ratio if ratio < _SHORTER and not _balance_explains(blocks, best) else None


def _balance_explains(blocks: PairBlocks, peak: _Peak) -> bool:
    """Whether gains of red and blue do about as well, with equal exposures."""
    equal, other = (find_neighbours(blocks, ratio) for ratio in (1.0, float(np.exp(peak.log))))
    balance = None if equal is None else find_balance_change(equal)
    if equal is None or other is None or balance is None:
        return False
    by_ratio = other.through(peak.curve).height(np.zeros(2), _WIDTHS)
    curves = NO_CONTRAST, peak.curve
    by_gains = max(equal.through(curve).height(balance.logs, _WIDTHS) for curve in curves)
    return by_gains > _ABOUT_AS_HIGH * by_ratio


@dataclass(frozen=True)
class _Peak:
    """The highest through a contrast. log: natural logarithm of its ratio.

    Heights in % of the pairs, of it, with equal exposures, and by a ratio at which the lamps' light
    hardly counts.
    """

    curve: ToneCurve
    log: float
    height: float
    equal: float
    itself: float


def _peak(srgb: Floats64, known: Mask, curve: ToneCurve) -> _Peak | None:
    """Through a contrast. srgb: (2, h, w, 3), linear by sRGB's curve. known: bool (h, w)."""
    light = curve.light(srgb) @ TO_SENSOR.T
    dark = light.min(axis=(0, 3)) <= LEAST_LIGHT
    no_flash, flash = np.where(dark[..., None], 1.0, light)
    seen = pairs_that_tell(no_flash, flash, known & ~dark)
    if seen is None:
        return None
    pairs, most = seen
    count = pairs.shape[1]
    pairs = pairs[:, np.linspace(0, count - 1, min(count, _PAIRS)).astype(int)]
    log, height = highest_peak(pairs, float(np.log(most)))
    lowest = float(np.log(most)) - BELOW
    less = np.exp(-_LESS_CONTRAST * bool(curve.logs.any()))
    heights = height, height_of(pairs, 0.0), height_of(pairs, lowest)
    return _Peak(curve, log, *(float(less * one) for one in heights))
