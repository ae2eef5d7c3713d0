"""How many pixels a photograph may have."""

from __future__ import annotations

import math
import os

from pipeline.errors import OptionError


def max_pixels() -> float:
    """Largest number of pixels accepted: LIGHTLAYERS_MAX_PIXELS, else 200 million.

    Raises OptionError where that is no number.
    """
    text = os.environ.get("LIGHTLAYERS_MAX_PIXELS", "200e6")
    try:
        limit = float(text)
    except ValueError:
        limit = math.nan
    if not limit > 0:
        raise OptionError(f"LIGHTLAYERS_MAX_PIXELS is {text!r}: set it to a number of pixels.")
    return limit
