"""Small pairs of a few even colours, as the fit gets them."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.arrays import Floats64
from pipeline.pair.reduced import ReducedPair

HEIGHT, WIDTH = 40, 80
"""So small that neighbours which are compared lie next to each other."""


def reduced_pair(no_flash: Any, flash: Any, flash_only: bool = False, **more: Any) -> ReducedPair:
    """A pair of which all is usable, without noise, unless more says otherwise."""
    given: dict[str, Any] = {
        "no_flash_variance": np.zeros_like(no_flash),
        "flash_variance": np.zeros_like(flash),
        "usable": np.ones(no_flash.shape[:2], bool),
        "block": 1,
        "rendered": False,
        "flash_only": flash_only,
    }
    given.update({k: np.broadcast_to(v, no_flash.shape) for k, v in more.items() if k != "usable"})
    if "usable" in more:
        given["usable"] = more["usable"]
    return ReducedPair(no_flash=no_flash, flash=flash, **given)


def even(*rgb: float) -> Floats64:
    """One colour everywhere."""
    return np.tile(np.array(rgb), (HEIGHT, WIDTH, 1))


def left_and_right(left: Floats64, right: Floats64) -> Floats64:
    """The left half of one picture, the right half of another."""
    return np.where(np.arange(WIDTH)[None, :, None] < WIDTH // 2, left, right)
