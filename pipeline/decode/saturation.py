"""From which value on the photosites of a sensor, or the linear values of a file, are clipped."""

from __future__ import annotations

from typing import Any

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
_MOST_PILED = 0.5
"""Share of a picture's values; where more are alike, it is even and not clipped."""


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
    return float(np.ceil(end)) if _pile_up(values, end, _PILE * white) else limit


def end_below_white(values: NDArray[Any], white: float) -> float | None:
    """Value from which linear values are clipped that pile up below white; None if they do not.

    values: of one channel, any shape. Whoever wrote a sensor's values on another scale, or balanced
    them, has moved the end of each channel: values of 14 bits in a file of 16 end at a quarter.
    """
    most = float(values.max(initial=0))
    if not 0 < most < white:
        return None
    end = (1 - _PILE) * most
    even = _reaching(values, end) > _MOST_PILED * values.size
    return end if not even and _pile_up(values, end, _PILE * most) else None


def _pile_up(values: NDArray[Any], end: float, width: float) -> bool:
    """Whether values lie from an end on, and few just below it; width: of what lies there."""
    pile = _reaching(values, end)
    return pile >= _FEWEST and pile >= _reaching(values, end - _BELOW * width) - pile


def _reaching(values: NDArray[Any], limit: float) -> int:
    return int(np.count_nonzero(values >= limit))
