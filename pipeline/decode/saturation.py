"""From which value on the photosites of a sensor count as clipped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

RAW_CLIP = 0.99
"""Share of the white level from which a sensor value counts as clipped."""

_LEAST = 0.75
"""Of the white level; no sensor ends below, as LibRaw holds when it looks for that end."""
_PILE = 0.005
"""Of the white level, how far the values of clipped photosites scatter at most."""
_BELOW = 10
"""Piles' widths below a pile that hold no more photosites than it; even light spreads over them."""
_FEWEST = 100
"""Photosites of a pile; of fewer, chance decides where they lie."""


def saturation(values: NDArray[np.uint16], black: float, white: float) -> float:
    """Value from which photosites count as clipped: .99 of the white level, or where they pile up.

    values: of photosites, any shape, all of one colour where colours end at different values.
    black: what they measure without light. white: what the file or LibRaw says they measure at
    white, more than black. Some sensors end below that, by up to a tenth (those of the Nikon D7000
    at 15778 in green and 16383 in red and blue, where LibRaw has 16383 for all): the most that is
    measured is then measured by many, and by few what is just below it, while light that rises
    smoothly, or is even but for its noise, has ever fewer photosites towards its brightest.
    """
    limit = float(np.ceil(black + RAW_CLIP * white))
    most = float(values.max(initial=0))
    if most >= limit or most < black + _LEAST * white:
        return limit
    end = most - _PILE * white
    pile = _reaching(values, end)
    below = _reaching(values, end - _BELOW * _PILE * white) - pile
    return float(np.ceil(end)) if pile >= max(below, _FEWEST) else limit


def _reaching(values: NDArray[np.uint16], limit: float) -> int:
    return int(np.count_nonzero(np.greater_equal(values, limit)))
