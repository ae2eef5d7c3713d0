"""The photograph as under one neutral light, as published.

Source: Hui et al. 2018, supplement, white balance I and II.
"""

from __future__ import annotations

import numpy as np

from pipeline.hui2018.invariant import light_coefficients
from pipeline.images.frames import Image, Matrix
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.separation.proportions import predictions
from pipeline.separation.separation import Strip


class PublishedWhiteBalance:
    """Approaches I and II, with T_n from the model's basis."""

    def __init__(self, lamps: Lamps, model: Model) -> None:
        self._lamps = lamps
        self._tensor = model.tensor
        self._to_neutral = model.lamp_matrix(model.neutral)
        self._axes = model.published
        self._strength = float(np.linalg.norm(self._axes @ model.neutral))
        self._strengths = np.linalg.norm(lamps.coefficients @ self._axes.T, axis=1) / self._strength

    def of(self, strip: Strip, first: bool, second: bool) -> tuple[Image | None, Image | None]:
        """Both approaches where wanted, (h, W, 3) linear camera RGB under the neutral light."""
        balanced_1 = self._approach_1(strip) if first else None
        return balanced_1, self._approach_2(strip) if second else None

    def _approach_1(self, strip: Strip) -> Image:
        """The coefficients of every lamp in eq. 3, of length 1, replaced by those of neutral light.

        I = Σ_j z_j ‖b_j‖/‖b_n‖ T_n I_f, lengths in the coordinates of Γ. The source does not say
        how long b_n is; as approach II takes b_i·b_j of any two lamps for 1, all have length 1.
        """
        brightness = np.zeros(strip.flash.shape[:2], dtype=np.float32)
        predicted = predictions(strip.flash, self._lamps)
        for layer, one, scale in zip(strip.layers, predicted, self._strengths, strict=True):
            energy = (one * one).sum(axis=2)
            lit = energy > 0
            z = np.where(lit, (layer * one).sum(axis=2) / np.where(lit, energy, 1.0), 0.0)
            brightness += z * scale
        return _neutral(strip.flash, brightness, self._to_neutral)

    def _approach_2(self, strip: Strip) -> Image:
        """All light replaced by neutral light of the same strength ‖β‖.

        I = ‖β‖/‖b_n‖ T_n I_f, lengths in the coordinates of Γ. Any number of lamps will do, since
        none is told from the other.
        """
        beta = light_coefficients(strip.no_flash, strip.flash, self._tensor) @ self._axes.T
        strength = (np.linalg.norm(beta, axis=-1) / self._strength).astype(np.float32)
        return _neutral(strip.flash, strength, self._to_neutral)


def _neutral(flash: Image, strength: Image, matrix: Matrix) -> Image:
    lit = flash @ matrix.T.astype(np.float32)
    return np.asarray(np.maximum(strength[..., None] * lit, 0.0), dtype=np.float32)
