"""Photographs under lamps and a flash, and their ratios."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.images.noise import Noise
from pipeline.pair.estimate_noise import estimate_noises
from pipeline.pair.ratios import (
    Ratios,
    block_ratios,
)

HEIGHT, WIDTH = 192, 256
LAMP, FLASH = np.array([1.0, 0.7, 0.4]), np.array([0.7, 0.9, 1.0])
QUIET = Noise(np.full(3, 1e-8), np.full(3, 1e-11))


def albedo(seed: int = 1) -> Floats64:
    values = np.random.default_rng(seed).uniform(0.2, 0.9, (HEIGHT // 16, WIDTH // 16, 3))
    return values.repeat(16, 0).repeat(16, 1)


def ratios_of(
    lamps: Floats64, flash_frame: Floats64, unusable: NDArray[np.bool_] | None = None
) -> Ratios:
    """Of the photographs with the noise of a sensor."""
    rng = np.random.default_rng(5)
    one, other = (
        (light + rng.normal(size=light.shape) * np.sqrt(light / 2e4 + 1e-7)).astype(np.float32)
        for light in (lamps, flash_frame)
    )
    bad = np.zeros(lamps.shape[:2], bool) if unusable is None else unusable
    return block_ratios(one, other, bad, estimate_noises(one, other))


def scene(reach: float = 1.0) -> tuple[Floats64, Floats64]:
    """Light of lamps and of a flash that reaches so much of the picture from the right."""
    u = np.linspace(0, 1, WIDTH)[None, :, None]
    lamps = albedo() * (0.2 + 0.4 * (1 - u)) * LAMP
    flash = albedo() * 0.4 * FLASH * (0.5 + 0.5 * u) * (u > 1 - reach)
    return lamps, flash
