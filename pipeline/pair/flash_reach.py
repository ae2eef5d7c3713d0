"""How much of what the lamps light the flash reaches, and how much stronger it should be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.pair.pair import Pair
from pipeline.pair.reduced import ReducedPair

NEEDED = 1.5
"""Standard deviations of a pixel's noise that its flash part must have to be separated."""

MOST_STOPS = 6.0
"""A flash further from reaching is not mended by its power."""

_LIT = 0.01  # of the 99th percentile; darker places are black to the eye
_SIGNIFICANT = 4.0  # standard deviations of a block's mean
_REACHED = 0.9


@dataclass(frozen=True)
class FlashReach:
    """Of what the lamps light, by area.

    weak: share 0…1 where the flash part is lost in the noise. stops: by which the flash must be
    stronger to reach nine tenths, 0…MOST_STOPS.
    """

    weak: float
    stops: float


def flash_reach(pair: Pair, reduced: ReducedPair) -> FlashReach:
    """Compare the flash part with the noise of single pixels, block by block.

    What is black in both photographs counts neither way: there is no light to separate.
    """
    light = reduced.no_flash.sum(axis=2)
    block_noise = np.sqrt(reduced.no_flash_variance.sum(axis=2))
    lit = (light > _LIT * np.percentile(light, 99)) & (light > _SIGNIFICANT * block_noise)
    if not lit.any():
        return FlashReach(0.0, 0.0)
    no_flash, part = reduced.no_flash[lit], reduced.flash[lit]
    variance = pair.flash_noise.variance(part if pair.flash_only else part + no_flash).sum(axis=1)
    if not pair.flash_only:
        variance = variance + pair.no_flash_noise.variance(no_flash).sum(axis=1)
    least = NEEDED * np.sqrt(variance)
    strength = part.sum(axis=1)
    factor = least / np.maximum(strength, 2.0**-MOST_STOPS * np.maximum(least, 1e-12))
    return FlashReach(
        weak=float(np.mean(strength <= least)),
        stops=float(np.log2(max(np.quantile(factor, _REACHED), 1.0))),
    )
