"""The photograph as under one neutral light.

Source: Hui et al. 2018, supplement, white balance I and II.
"""

from __future__ import annotations

import numpy as np

from pipeline.frames import Image, Matrix
from pipeline.hui2018.invariant import light_coefficients
from pipeline.lamps import Lamps
from pipeline.model import Model
from pipeline.proportions import predictions
from pipeline.separation import Strip

_BRIGHTEST = 4.0
_FAINTEST = 0.02  # of a lamp's strongest channel, so that no ratio explodes


def approach_1(strip: Strip, lamps: Lamps, model: Model, method: str) -> Image:
    """Every lamp replaced by the neutral light of the same green response; (h, W, 3) camera RGB.

    I = Σ_j (z_j g_j / g_n) T_n I_f: colour from the flash photograph, brightness z_j from the
    layers, g the green response of a white card. "paper" takes T_n from the model's basis
    (approach I), "best" the matrix that fits measured reflectances best, and where the flash part
    is of no use scales the channels of the layers instead (von Kries).
    """
    matrix = _to_neutral(model, method)
    whites = _whites(lamps, model)
    brightness = np.zeros(strip.flash.shape[:2], dtype=np.float32)
    for layer, predicted, white in zip(
        strip.layers, predictions(strip.flash, lamps), whites, strict=True
    ):
        energy = (predicted * predicted).sum(axis=2)
        lit = energy > 0
        z = np.where(lit, (layer * predicted).sum(axis=2) / np.where(lit, energy, 1.0), 0.0)
        brightness += z * white[1]
    neutral = _neutral(strip.flash, brightness / (matrix @ model.flash_white)[1], matrix)
    return neutral if method == "paper" else _filled(strip, neutral, whites, model)


def approach_2(strip: Strip, lamps: Lamps, model: Model, method: str) -> Image:
    """All light replaced by neutral light of the same strength ‖β‖; (h, W, 3) camera RGB.

    I = ‖β‖/‖b_n‖ T_n I_f. Any number of lamps will do, since none is told from the other. T_n and
    what is done where the flash part is of no use are those of approach I.
    """
    length = np.linalg.norm(light_coefficients(strip.no_flash, strip.flash, model.tensor), axis=-1)
    strength = (length / np.linalg.norm(model.neutral)).astype(np.float32)
    neutral = _neutral(strip.flash, strength, _to_neutral(model, method))
    if method == "paper":
        return neutral
    # near-singular pixels give any length: nothing gets far brighter than the photograph
    limit = _BRIGHTEST * strip.no_flash.max(axis=2, keepdims=True)
    neutral *= np.minimum(1.0, limit / np.maximum(neutral.max(axis=2, keepdims=True), 1e-9))
    return _filled(strip, neutral, _whites(lamps, model), model)


def _to_neutral(model: Model, method: str) -> Matrix:
    """Matrix (3, 3) T_n from the flash part to the same under the neutral light."""
    return model.flash_to_neutral if method == "best" else model.lamp_matrix(model.neutral)


def _whites(lamps: Lamps, model: Model) -> Matrix:
    """Camera RGB (N, 3) of a white card that a lamp lights like the flash does."""
    whites = lamps.matrices @ model.flash_white
    return np.asarray(np.maximum(whites, _FAINTEST * np.abs(whites).max(axis=1, keepdims=True)))


def _neutral(flash: Image, strength: Image, matrix: Matrix) -> Image:
    lit = flash @ matrix.T.astype(np.float32)
    return np.asarray(np.maximum(strength[..., None] * lit, 0.0), dtype=np.float32)


def _filled(strip: Strip, neutral: Image, whites: Matrix, model: Model) -> Image:
    """Scale the channels of the layers instead where the flash part is of no use (von Kries)."""
    white = model.flash_to_neutral @ model.flash_white
    ratios = (white / white[1] / (whites / whites[:, 1:2])).astype(np.float32)
    scaled = np.einsum("nhwk,nk->hwk", strip.layers, ratios)
    trust = strip.confidence[..., None]
    return np.asarray(trust * neutral + (1.0 - trust) * np.maximum(scaled, 0.0))
