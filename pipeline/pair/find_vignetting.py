"""Finds corners that are darker in one photograph only, by the colours of what the flash added.

Another aperture, or a lens correction of one photograph, gives every place a ratio of the exposures
of its own. By the wrong one some of the lamps' light stays in the flash part, or too much is taken
off it, so that it has many colours on one surface (find_exposure_ratio). That the flash's own light
becomes darker or brighter with the lamps' does not count: only its colour tells.
"""

from __future__ import annotations

import numpy as np

from pipeline.pair.find_exposure_ratio import OFFSETS, larger_blocks
from pipeline.pair.one_surface import pairs_apart
from pipeline.pair.pairs_of_places import Places
from pipeline.pair.ratios import Ratios
from pipeline.pair.vignetting import Vignetting, squared_radius

# Chosen on development scenes (docs/trials/optics.md)
_FEW_PAIRS = 300
_MOST = 1.0  # of the lamps' light, in the corners or everywhere
_NOTABLE, _TOO_MUCH = 0.15, 0.9  # in the corners; what ends at the limit is a wrong ratio
_GAIN = 1.05  # times the height without
_CHANCE = 0.14  # times the root of the height: how many pairs there are is chance
_LEAST_HEIGHT = 1.5  # % of the pairs; of lower peaks noise makes as much


def find_vignetting(ratios: Ratios) -> Vignetting | None:
    """By how much the flash photograph's corners are brighter or darker; None where none show.

    ratios: of a linear pair on one scale, not of a rendered one.
    """
    no_flash, flash, known = larger_blocks(ratios)
    pairs = pairs_apart(no_flash / flash, known, OFFSETS, _FEW_PAIRS)
    if pairs is None:
        return None
    light = no_flash.reshape(-1, 3)[pairs]
    part = flash.reshape(-1, 3)[pairs] - light
    real = (part > 0).all(axis=(0, 2))
    if np.count_nonzero(real) < _FEW_PAIRS:
        return None
    radius = squared_radius(*known.shape).ravel()[pairs][:, real, None]
    light = light[:, real]
    places = Places(part[:, real], np.stack([light, radius * light]))
    none = np.zeros(2)
    ratio, corners = (places.fit([free], none, _MOST) for free in (0, 1))
    # a wrong ratio of the exposures looks alike where the lamps light the corners most
    without = max(places.height(none), places.height(ratio), _LEAST_HEIGHT)
    if places.height(corners) < max(_GAIN * without, without + _CHANCE * np.sqrt(without)):
        return None
    found = float(corners[1])
    return Vignetting(found) if _NOTABLE < abs(found) < _TOO_MUCH else None
