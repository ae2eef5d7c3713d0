"""How noisy a photograph is, as a straight line over brightness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats, Floats64

GRAIN_SCALES = (2, 4, 8)
"""Sides in pixels of the squares whose means tell over what area noise hangs together."""

_MIDDLE = 0.2  # of white; where the noise of two kinds is compared


@dataclass(frozen=True)
class Noise:
    """Variance of a photograph's values: gain·I + floor, one of each per channel.

    gain, floor: float64 (3,), linear camera RGB units. grain: area in pixels over which the noise
    hangs together, 1 for a bare sensor, more after demosaicing, denoising and compression.
    """

    gain: Floats64
    floor: Floats64
    grain: float = 1.0

    def variance(self, pixels: Floats, averaged: float | Floats = 1.0) -> Floats64:
        """Variance of values (..., 3), or of means of so many neighbouring pixels."""
        single = self.gain * np.maximum(pixels, 0.0) + self.floor
        return np.asarray(single * np.minimum(1.0, self.grain / averaged))

    def of_means(self, block: int) -> Noise:
        """The noise of means over block × block pixels."""
        less = min(1.0, self.grain / block**2)
        return Noise(self.gain * less, self.floor * less, max(self.grain / block**2, 1.0))

    def divided(self, by: float) -> Noise:
        """The noise of the same photograph, all values divided by a positive number."""
        return Noise(self.gain / by, self.floor / by**2, self.grain)

    def blurred(self, left: float) -> Noise:
        """The noise of the same photograph after a blur that leaves a part of its variance, 0…1.

        What hung together over one pixel hangs together over more: means of many keep theirs.
        """
        return Noise(self.gain * left, self.floor * left, self.grain / left)

    def plus(self, other: Noise) -> Noise:
        """Both noises together; they are independent of each other."""
        own, others = (one.variance(np.full(3, _MIDDLE)).sum() for one in (self, other))
        grain = float((own * self.grain + others * other.grain) / (own + others))
        return Noise(self.gain + other.gain, self.floor + other.floor, grain)


def line_through(brightness: Floats, variances: Floats) -> tuple[float, float]:
    """Non-negative gain and floor of a line through variances (n,) over brightness (n,).

    Least squares of relative errors.
    """
    weight = 1.0 / (variances + 1e-3 * variances.max() + 1e-14)
    matrix = np.column_stack([brightness, np.ones_like(brightness)]) * weight[:, None]
    gain, floor = np.linalg.lstsq(matrix, variances * weight, rcond=None)[0]
    if gain < 0:
        gain, floor = 0.0, float(np.average(variances, weights=weight))
    if floor < 0:
        mean = float(np.average(variances, weights=weight))
        floor, gain = 0.0, mean / max(float(np.average(brightness, weights=weight)), 1e-9)
    return max(float(gain), 1e-10), max(float(floor), 1e-13)
