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
from pipeline.spectra.matrices import best_matrix

_BRIGHTEST = 4.0
_FAINTEST = 0.02  # of a lamp's strongest channel, so that no ratio explodes
_LACKING = (0.06, 0.2)  # of the strongest channel, between which a lamp comes to have a colour
_CLIPPING = (0.9, 0.99)  # of white, between which a channel comes to count as clipped


def approach_1(strip: Strip, lamps: Lamps, model: Model, method: str) -> Image:
    """Every lamp replaced by the neutral light of the same green response; (h, W, 3) camera RGB.

    I = Σ_j (z_j g_j / g_n) T_n I_f: colour from the flash photograph, brightness z_j from the
    layers, g the green response of a white card. "paper" takes T_n from the model's basis
    (approach I), "best" the matrix that fits measured reflectances best, and where the flash part
    is of no use the one that takes each lamp's layer to the neutral light; what is clipped in two
    channels or three has no colour to keep, and becomes white.
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
    return neutral if method == "paper" else _filled(strip, neutral, lamps, model)


def approach_2(strip: Strip, lamps: Lamps, model: Model, method: str) -> Image:
    """All light replaced by neutral light of the same strength ‖β‖; (h, W, 3) camera RGB.

    I = ‖β‖/‖b_n‖ T_n I_f. Any number of lamps will do, since none is told from the other. T_n and
    what is done where the flash part is of no use, or the photograph clipped, are those of
    approach I.
    """
    length = np.linalg.norm(light_coefficients(strip.no_flash, strip.flash, model.tensor), axis=-1)
    strength = (length / np.linalg.norm(model.neutral)).astype(np.float32)
    neutral = _neutral(strip.flash, strength, _to_neutral(model, method))
    if method == "paper":
        return neutral
    # near-singular pixels give any length: nothing gets far brighter than the photograph
    limit = _BRIGHTEST * strip.no_flash.max(axis=2, keepdims=True)
    neutral *= np.minimum(1.0, limit / np.maximum(neutral.max(axis=2, keepdims=True), 1e-9))
    return _filled(strip, neutral, lamps, model)


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


def _filled(strip: Strip, neutral: Image, lamps: Lamps, model: Model) -> Image:
    """Take colours from the layers instead where the flash part is of no use."""
    matrices = _from_layers(lamps, model).astype(np.float32)
    balanced = sum(layer @ one.T for layer, one in zip(strip.layers, matrices, strict=True))
    trust = strip.confidence[..., None]
    balanced = trust * neutral + (1.0 - trust) * np.maximum(balanced, 0.0)
    return _highlights_white(balanced, strip.layers.sum(axis=0), _neutral_white(model))


def _from_layers(lamps: Lamps, model: Model) -> Matrix:
    """Matrices (N, 3, 3), a lamp's layer → the same under the neutral light, its green kept.

    Best for measured reflectances under the spectrum that the lamp has by its matrix, channels then
    scaled so that its white card is white. Of a lamp that lacks a colour the layer does not tell
    it either, and its channels are scaled alone (von Kries).
    """
    s, neutral = model.sensitivities, _neutral_white(model)
    found = []
    for matrix, white in zip(lamps.matrices, _whites(lamps, model), strict=True):
        spectrum = model.lamp_spectra.spectrum(matrix)
        spectrum = spectrum / (s[1] @ spectrum)
        seen = white / white[1]
        scaled = np.diag(neutral / seen)
        one = best_matrix(s * spectrum, s * model.neutral_light)
        one = neutral[:, None] * one / np.maximum(one @ seen, neutral / 2)[:, None]
        low, high = _LACKING
        trust = np.clip((white.min() / white.max() - low) / (high - low), 0.0, 1.0)
        found.append(trust * one + (1.0 - trust) * scaled)
    return np.stack(found)


def _neutral_white(model: Model) -> Matrix:
    """A white card's colour (3,) under the neutral light, green 1."""
    white = model.flash_to_neutral @ model.flash_white
    return np.asarray(white / white[1])


def _highlights_white(balanced: Image, photograph: Image, white: Matrix) -> Image:
    """Make white what is clipped in two channels: gains would give it the colour of no lamp.

    white: (3,), a white card's under the neutral light. Its brightness is the least that all
    channels have, if it is white.
    """
    low, high = _CLIPPING
    clipped = np.clip((photograph - low) / (high - low), 0.0, 1.0)
    second = clipped.sum(axis=2) - clipped.max(axis=2) - clipped.min(axis=2)
    share = second[..., None].astype(np.float32)
    white = white.astype(np.float32)
    brightness = (balanced / white).max(axis=2, keepdims=True)
    return np.asarray((1.0 - share) * balanced + share * brightness * white)
