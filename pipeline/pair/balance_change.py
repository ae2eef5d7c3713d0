"""What a camera gave one photograph of a pair more of red and blue than the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Image, Matrix, Photograph
from pipeline.images.memory import empty_image
from pipeline.images.noise import Noise
from pipeline.images.strips import strips

_ROWS = 64

_TO_SRGB: Matrix = np.array(((1.7, -0.6, -0.1), (-0.2, 1.55, -0.35), (0.0, -0.5, 1.5)))
TO_SENSOR: Matrix = np.linalg.inv(_TO_SRGB).astype(np.float64)
"""Linear sRGB → about the RGB of a sensor, grey left as it is.

Cameras multiply the sensor's channels and turn the product into sRGB; their matrices are alike once
grey is grey.
"""


@dataclass(frozen=True)
class BalanceChange:
    """By how much more red and blue the sensor's values of the flash photograph were multiplied.

    1 as much as those of the other; green as much.
    """

    red: float
    blue: float

    @property
    def logs(self) -> Floats64:
        """Natural logarithms (2,) of the gains of red and blue."""
        return np.log((self.red, self.blue))

    @property
    def matrix(self) -> Matrix:
        """Linear sRGB of the flash photograph → as balanced as the other, (3, 3)."""
        less = 1.0 / np.array((self.red, 1.0, self.blue))
        return np.asarray(_TO_SRGB @ (less[:, None] * TO_SENSOR))

    def entry(self) -> dict[str, Any]:
        """The gains, for the manifest."""
        return {"red": round(self.red, 3), "blue": round(self.blue, 3)}

    def photograph(self, photograph: Photograph, own: bool = False) -> Image:
        """A flash photograph (H, W, 3) as balanced as the other. own: may be overwritten."""
        if own and isinstance(photograph, np.ndarray):
            balanced = photograph
        else:
            balanced = empty_image(*photograph.shape)
        matrix = self.matrix.astype(np.float32)
        for rows in strips(len(photograph), _ROWS):
            balanced[rows] = cv2.transform(np.ascontiguousarray(photograph[rows]), matrix)
        return balanced

    def noise(self, noise: Noise) -> Noise:
        """What the noise of the flash photograph becomes by that, in grey light."""
        squares = np.square(self.matrix)
        gain = squares @ noise.gain / self.matrix.sum(axis=1)
        return Noise(gain, squares @ noise.floor, noise.grain)
