"""Blocks of a photograph's pixels."""

from __future__ import annotations

import numpy as np

from pipeline.compiling import njit
from pipeline.frames import Mask


@njit(cache=True)
def any_in_blocks(mask: Mask, block: int) -> Mask:
    """Whether a block of so many pixels to a side holds a marked one, (H // block, W // block).

    mask: (H, W). What is left over at the right and bottom edge after whole blocks is dropped.
    """
    height, width = mask.shape[0] // block, mask.shape[1] // block
    found = np.zeros((height, width), np.bool_)
    for y in range(height * block):
        for x in range(width):
            if not found[y // block, x]:
                found[y // block, x] = mask[y, x * block : (x + 1) * block].any()
    return found
