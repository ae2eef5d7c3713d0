"""The simulated sensor: light to 14-bit numbers, with the noise of counting electrons."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BASE_ISO = 100
BLACK = 600
WHITE = 15892
"""Numbers of a 14-bit file for no light and for a full photosite."""

FULL_WELL_E = 40_000
"""Electrons that fill a photosite; at base ISO that is the white level."""

READ_NOISE_E = 3.0
"""Standard deviation of reading out, in electrons."""


def digitise(
    light: NDArray[np.float32], iso: float, noise: np.random.Generator | None
) -> NDArray[np.uint16]:
    """Read out the sensor.

    light: (H, W), linear, 1.0 fills a photosite. noise: where the randomness comes from; None
    reads the exact light.
    """
    electrons = light * np.float32(FULL_WELL_E)
    if noise is not None:
        electrons = noise.poisson(electrons).astype(np.float32)
        electrons += noise.standard_normal(electrons.shape, np.float32) * np.float32(READ_NOISE_E)
    gain = (WHITE - BLACK) / FULL_WELL_E * iso / BASE_ISO
    numbers = np.rint(electrons * np.float32(gain)) + BLACK
    return np.asarray(np.clip(numbers, 0, WHITE), np.uint16)
