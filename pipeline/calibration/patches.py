"""Surfaces of known reflectance, as the camera sees them by the light of the flash."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64

_RELATIVE, _OF_BRIGHTEST = 0.015, 0.003
"""How far patches of one make differ, and glare: of the patch's light, of the brightest one's."""
_POOR_WEIGHT = 0.02  # of the brightest: darker patches count by their absolute error


@dataclass(frozen=True)
class Patches:
    """Light of the flash on patches.

    flash: (n, 3) linear camera RGB. variance: (n, 3), of its noise. reflectances: (n, W).
    places: (n, 2) in the chart's plane, −1…1, over which the flash may fall off.
    """

    flash: Floats64
    variance: Floats64
    reflectances: Floats64
    places: Floats64

    @property
    def tolerance(self) -> Floats64:
        """Variance (n, 3) of what a right prediction misses: noise, other pigments and glare."""
        other = (_RELATIVE * self.flash) ** 2 + (_OF_BRIGHTEST * self.flash.max()) ** 2
        return np.asarray(self.variance + other)

    def fall_off(self, predicted: Floats64) -> Floats64:
        """How bright the flash is on each patch (n, 1), 1 in the geometric mean.

        predicted: (n, 3) light under an even flash, up to a factor. An exponential of a square
        polynomial of the place, fitted to the brightness that patches have beyond the prediction.
        """
        x, y = self.places.T
        terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
        if len(terms) <= terms.shape[1]:
            return np.ones((len(terms), 1))
        bright = np.maximum(predicted.sum(axis=1), 1e-12)
        ratio = np.log(np.maximum(self.flash.sum(axis=1), 1e-12) / bright)
        weight = self.flash.sum(axis=1) / np.sqrt(self.tolerance.sum(axis=1))
        solution = np.linalg.lstsq(terms * weight[:, None], ratio * weight, rcond=None)[0]
        field = terms[:, 1:] @ solution[1:]
        return np.asarray(np.exp(field - field.mean())[:, None])

    def misfit(self, predicted: Floats64) -> float:
        """Root mean square error of a prediction (n, 3), relative to each patch's light."""
        return float(np.sqrt(np.mean(np.square((predicted - self.flash) / self._scale))))

    @property
    def noise(self) -> float:
        """Misfit that noise alone leaves."""
        return float(np.sqrt(np.mean(self.variance / np.square(self._scale))))

    @property
    def _scale(self) -> Floats64:
        return np.asarray(self.flash + _POOR_WEIGHT * self.flash.max())
