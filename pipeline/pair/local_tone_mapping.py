"""What a camera's local tone mapping gave one photograph of a pair and not the other.

Phones and many cameras darken what has bright surroundings and brighten what has dark ones: light
over a power of its surroundings. Where the flash makes the surroundings brighter, the flash
photograph is darkened, and no longer the sum of lamps and flash.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.enlarge import enlarge
from pipeline.images.frames import Image, Photograph
from pipeline.images.memory import empty_image
from pipeline.images.noise import Noise
from pipeline.images.strips import strips

_ROWS = 64


@dataclass(frozen=True)
class LocalToneMapping:
    """By what the flash photograph is to be multiplied for both to be mapped alike.

    logs: (h, w), natural logarithms, of blocks of `side` pixels. power: 0…1, of its surroundings,
    by which the camera divided light.
    """

    logs: Floats64
    side: int
    power: float

    def entry(self) -> dict[str, Any]:
        """The power, and the least and greatest factor, for the manifest."""
        least, most = np.exp((self.logs.min(), self.logs.max()))
        return {
            "power": round(self.power, 3),
            "least": round(float(least), 3),
            "most": round(float(most), 3),
        }

    def photograph(self, photograph: Photograph, own: bool = False) -> Image:
        """A flash photograph (H, W, 3) mapped as the other is. own: may be overwritten."""
        if own and isinstance(photograph, np.ndarray):
            mapped = photograph
        else:
            mapped = empty_image(*photograph.shape)
        factors = np.exp(self.logs)[..., None].astype(np.float32)
        for rows in strips(len(photograph), _ROWS):
            light = photograph[rows]
            planes = np.empty((1, *light.shape[:2]), np.float32)
            enlarge(factors, self.side, rows, planes)
            np.multiply(light, planes[0, ..., None], out=mapped[rows])
        return mapped

    def noise(self, noise: Noise) -> Noise:
        """What the noise of the flash photograph becomes by that, in the mean."""
        return noise.divided(1.0 / float(np.exp(self.logs).mean()))
