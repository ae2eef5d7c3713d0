"""Bands along the rows of the sensor in which lamps gave more, or less, by the flash photograph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats, Floats64
from pipeline.images.frames import Image, Photograph
from pipeline.images.memory import empty_image
from pipeline.images.strips import STRIP_ROWS, strips

WAVES = 2
"""The wave of the mains and its first overtone, which the ratio of two waves has."""

_SAMPLES = 256  # of one wave


@dataclass(frozen=True)
class Banding:
    """By how much more light all lamps gave, row by row, of what they gave without the flash.

    period: of the wave, in rows. terms: (2 × WAVES,), see series. by_columns: whether the sensor's
    rows are the picture's columns.
    """

    period: float
    terms: Floats64
    by_columns: bool

    @property
    def height(self) -> float:
        """The most by which a row departs from no change, of the lamps' light."""
        return float(np.abs(self.terms @ series(np.arange(_SAMPLES) / _SAMPLES)).max())

    def off(self, no_flash: Photograph, flash: Photograph) -> Image:
        """The flash photograph without it, (H, W, 3); no_flash, flash: on one scale."""
        height, width = flash.shape[:2]
        side = width if self.by_columns else height
        rows = (np.arange(side) + 0.5) / self.period
        more = np.asarray(self.terms @ series(rows), np.float32)
        more = more[None, :, None] if self.by_columns else more[:, None, None]
        out = empty_image(height, width, 3)
        for some in strips(height, STRIP_ROWS):
            out[some] = flash[some] - (more if self.by_columns else more[some]) * no_flash[some]
        return out


def series(waves: Floats) -> Floats64:
    """Cosine and sine of a wave and its overtones, (2 × WAVES, …), so many waves (…) on."""
    angles = 2 * np.pi * waves
    of_overtones = [(np.cos(n * angles), np.sin(n * angles)) for n in range(1, WAVES + 1)]
    return np.concatenate(of_overtones).astype(np.float64)
