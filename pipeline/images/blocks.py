"""Blocks of a photograph's pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.compiling import exact
from pipeline.images.frames import Mask


@dataclass(frozen=True)
class Blocks:
    """Square blocks that lie in a photograph from its upper left corner on.

    side: of a block in pixels. size: how many there are (across, down). What is left over at the
    right and bottom edge after whole blocks is in none.
    """

    side: int
    size: tuple[int, int]

    @property
    def crop(self) -> tuple[int, int]:
        """(width, height) in pixels of the part of the photograph that the blocks cover."""
        return self.size[0] * self.side, self.size[1] * self.side


def blocks_within(width: int, height: int, longest: int) -> Blocks:
    """The smallest blocks of a photograph of which its longer side has at most so many.

    width, height: of the photograph in pixels. A side that holds no whole block has one all the
    same, which goes beyond it.
    """
    side = -(-max(width, height) // longest)
    return Blocks(side, (max(width // side, 1), max(height // side, 1)))


def sums_of_blocks(image: Floats64, side: int) -> Floats64:
    """Sums (H // side, W // side, C) over squares of so many pixels to a side, or smaller blocks.

    image: (H, W, C). What is left over at the right and bottom edge is dropped.
    """
    height, width = (length // side for length in image.shape[:2])
    cropped = image[: height * side, : width * side]
    return np.asarray(cropped.reshape(height, side, width, side, -1).sum(axis=(1, 3)))


@exact
def any_in_blocks(mask: Mask, block: int) -> Mask:
    """Whether a block of so many pixels to a side holds a marked one, (H // block, W // block).

    mask: (H, W). What is left over at the right and bottom edge after whole blocks is dropped.
    """
    height, width = mask.shape[0] // block, mask.shape[1] // block
    found = np.zeros((height, width), np.bool_)
    for y in range(height * block):
        for x in range(width):
            for i in range(x * block, (x + 1) * block):
                found[y // block, x] |= mask[y, i]
    return found
