"""Corners that are darker in one photograph than in the other, as by another aperture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Image, Photograph
from pipeline.images.memory import empty_image
from pipeline.images.strips import STRIP_ROWS, strips


@dataclass(frozen=True)
class Vignetting:
    """By how much corners are brighter in the flash photograph than the exposures' ratio says.

    corners: of the light there, above −1, 0 none; below 0 they are darker. It grows with the square
    of the distance from the picture's middle.
    """

    corners: float

    def off(self, flash: Photograph) -> Image:
        """The flash photograph without it, (H, W, 3)."""
        height, width = flash.shape[:2]
        factors = (1 / (1 + self.corners * squared_radius(height, width))).astype(np.float32)
        out = empty_image(height, width, 3)
        for some in strips(height, STRIP_ROWS):
            out[some] = flash[some] * factors[some, :, None]
        return out


def squared_radius(height: int, width: int) -> Floats64:
    """Squared distance (height, width) from the middle, 1 in the corners of the picture."""
    y, x = ((2 * np.arange(side) + 1 - side) ** 2 for side in (height, width))
    return np.asarray((y[:, None] + x) / (height**2 + width**2), np.float64)
