"""The photograph as under one neutral light: our approaches I and II; compiled.

Source: Hui et al. 2018, supplement, white balance I and II, with matrices learnt from measured
reflectances, and colours from the layers where the flash part is of no use.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.frames import Image, Matrix
from pipeline.lamps import Lamps
from pipeline.model import Model
from pipeline.separation import Strip
from pipeline.spectra.matrices import best_matrix

_BRIGHTEST = 4.0
_FAINTEST = 0.02  # of a lamp's strongest channel, so that no ratio explodes
_LACKING = (0.06, 0.2)  # of the strongest channel, between which a lamp comes to have a colour
_CLIPPING = (0.9, 0.99)  # of white, between which a channel comes to count as clipped
_SINGULAR = 1e-9  # relative determinant


class WhiteBalance:
    """Approaches I and II: colour from the flash photograph, brightness from lamps or all light.

    T_n is the matrix that takes measured reflectances best from the flash to the neutral light.
    Where the flash part is of no use colours come from each lamp's layer; what is clipped in two
    channels or three has no colour to keep, and becomes white.
    """

    def __init__(self, lamps: Lamps, model: Model) -> None:
        self._matrices = lamps.matrices.astype(np.float32)
        self._to_neutral = model.flash_to_neutral
        greens = whites_of(lamps, model)[:, 1]
        self._brightness = greens / (self._to_neutral @ model.flash_white)[1]
        self._tensor = np.ascontiguousarray(model.tensor)
        self._strength = float(np.linalg.norm(model.neutral))
        self._from_layers = _from_layers(lamps, model).astype(np.float32)
        self._white = _neutral_white(model).astype(np.float32)

    def approach_1(self, strip: Strip, balanced: Image) -> None:
        """Every lamp replaced by the neutral light of the same green response.

        I = Σ_j (z_j g_j / g_n) T_n I_f, brightness z_j from the layers, g the green response of a
        white card. balanced: (h, W, 3), overwritten, linear camera RGB as under the neutral light.
        """
        _by_lamps(
            strip.flash, strip.layers, self._matrices, self._brightness, self._to_neutral, balanced
        )
        self._finish(strip, balanced)

    def approach_2(self, strip: Strip, balanced: Image) -> None:
        """All light replaced by neutral light of the same strength ‖β‖.

        I = ‖β‖/‖b_n‖ T_n I_f, but nowhere far brighter than the photograph. Any number of lamps
        will do, since none is told from the other. balanced: as in approach_1.
        """
        _by_strength(
            strip.no_flash, strip.flash, self._tensor, self._strength, self._to_neutral, balanced
        )
        self._finish(strip, balanced)

    def _finish(self, strip: Strip, balanced: Image) -> None:
        _finish(strip.layers, strip.confidence, self._from_layers, self._white, balanced)


def whites_of(lamps: Lamps, model: Model) -> Matrix:
    """Camera RGB (N, 3) of a white card that a lamp lights like the flash does, no channel 0."""
    whites = lamps.matrices @ model.flash_white
    return np.asarray(np.maximum(whites, _FAINTEST * np.abs(whites).max(axis=1, keepdims=True)))


def _from_layers(lamps: Lamps, model: Model) -> Matrix:
    """Matrices (N, 3, 3), a lamp's layer → the same under the neutral light, its green kept.

    Best for measured reflectances under the spectrum that the lamp has by its matrix, channels then
    scaled so that its white card is white. Of a lamp that lacks a colour the layer does not tell
    it either, and its channels are scaled alone (von Kries).
    """
    s, neutral = model.sensitivities, _neutral_white(model)
    found = []
    for matrix, white in zip(lamps.matrices, whites_of(lamps, model), strict=True):
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


@njit(cache=True, error_model="numpy")
def _by_lamps(
    flash: Image,
    layers: Image,
    matrices: Image,
    brightness: Matrix,
    to_neutral: Matrix,
    balanced: Image,
) -> None:
    """Write Σ_j brightness_j z_j T_n I_f, z_j = layer_j · T_j I_f / ‖T_j I_f‖²."""
    zero = np.float32(0.0)
    for y in range(flash.shape[0]):
        for x in range(flash.shape[1]):
            r, g, b = flash[y, x, 0], flash[y, x, 1], flash[y, x, 2]
            strength = 0.0
            for j in range(len(matrices)):
                m, energy, seen = matrices[j], zero, zero
                for k in range(3):
                    predicted = max(m[k, 0] * r + m[k, 1] * g + m[k, 2] * b, zero)
                    energy += predicted * predicted
                    seen += predicted * layers[j, y, x, k]
                if energy > 0:
                    strength += brightness[j] * (seen / energy)
            for k in range(3):
                lit = to_neutral[k, 0] * r + to_neutral[k, 1] * g + to_neutral[k, 2] * b
                balanced[y, x, k] = max(strength * lit, 0.0)


@njit(cache=True, error_model="numpy")
def _by_strength(
    no_flash: Image, flash: Image, d: Matrix, unit: float, to_neutral: Matrix, balanced: Image
) -> None:
    """Write ‖β‖/unit T_n I_f; β by Cramer's rule from the columns c_j = D_j I_f, as published."""
    for y in range(flash.shape[0]):
        for x in range(flash.shape[1]):
            r, g, b = flash[y, x, 0], flash[y, x, 1], flash[y, x, 2]
            n0, n1, n2 = no_flash[y, x, 0], no_flash[y, x, 1], no_flash[y, x, 2]
            a0 = d[0, 0, 0] * r + d[0, 1, 0] * g + d[0, 2, 0] * b
            a1 = d[1, 0, 0] * r + d[1, 1, 0] * g + d[1, 2, 0] * b
            a2 = d[2, 0, 0] * r + d[2, 1, 0] * g + d[2, 2, 0] * b
            b0 = d[0, 0, 1] * r + d[0, 1, 1] * g + d[0, 2, 1] * b
            b1 = d[1, 0, 1] * r + d[1, 1, 1] * g + d[1, 2, 1] * b
            b2 = d[2, 0, 1] * r + d[2, 1, 1] * g + d[2, 2, 1] * b
            c0 = d[0, 0, 2] * r + d[0, 1, 2] * g + d[0, 2, 2] * b
            c1 = d[1, 0, 2] * r + d[1, 1, 2] * g + d[1, 2, 2] * b
            c2 = d[2, 0, 2] * r + d[2, 1, 2] * g + d[2, 2, 2] * b
            u0, u1, u2 = b1 * c2 - b2 * c1, b2 * c0 - b0 * c2, b0 * c1 - b1 * c0
            v0, v1, v2 = c1 * a2 - c2 * a1, c2 * a0 - c0 * a2, c0 * a1 - c1 * a0
            w0, w1, w2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
            determinant = a0 * u0 + a1 * u1 + a2 * u2
            squared = a0 * a0 + a1 * a1 + a2 * a2
            squared *= b0 * b0 + b1 * b1 + b2 * b2
            squared *= c0 * c0 + c1 * c1 + c2 * c2
            strength = 0.0
            if abs(determinant) > _SINGULAR * np.sqrt(squared):
                u = u0 * n0 + u1 * n1 + u2 * n2
                v = v0 * n0 + v1 * n1 + v2 * n2
                w = w0 * n0 + w1 * n1 + w2 * n2
                strength = np.sqrt(u * u + v * v + w * w) / (abs(determinant) * unit)
            brightest = 0.0
            for k in range(3):
                lit = to_neutral[k, 0] * r + to_neutral[k, 1] * g + to_neutral[k, 2] * b
                lit = max(strength * lit, 0.0)
                brightest = max(brightest, lit)
                balanced[y, x, k] = lit
            # near-singular pixels give any length: nothing gets far brighter than the photograph
            limit = _BRIGHTEST * max(n0, n1, n2, np.float32(0.0))
            if brightest > limit:
                for k in range(3):
                    balanced[y, x, k] *= limit / max(brightest, 1e-9)


@njit(cache=True, error_model="numpy")
def _finish(
    layers: Image, confidence: Image, from_layers: Image, white: Image, balanced: Image
) -> None:
    """Take colours from the layers where the flash part is of no use; make highlights white.

    Gains would give what is clipped the colour of no lamp. Its brightness is the least that all
    channels have, if it is white.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    low, scale = np.float32(_CLIPPING[0]), np.float32(1.0 / (_CLIPPING[1] - _CLIPPING[0]))
    for y in range(confidence.shape[0]):
        for x in range(confidence.shape[1]):
            trust = confidence[y, x]
            r = g = b = zero
            red = green = blue = zero
            for j in range(len(layers)):
                m, layer = from_layers[j], layers[j, y, x]
                r += layer[0]
                g += layer[1]
                b += layer[2]
                red += m[0, 0] * layer[0] + m[0, 1] * layer[1] + m[0, 2] * layer[2]
                green += m[1, 0] * layer[0] + m[1, 1] * layer[1] + m[1, 2] * layer[2]
                blue += m[2, 0] * layer[0] + m[2, 1] * layer[1] + m[2, 2] * layer[2]
            red = trust * balanced[y, x, 0] + (one - trust) * max(red, zero)
            green = trust * balanced[y, x, 1] + (one - trust) * max(green, zero)
            blue = trust * balanced[y, x, 2] + (one - trust) * max(blue, zero)
            r, g, b = (
                min(max((r - low) * scale, zero), one),
                min(max((g - low) * scale, zero), one),
                min(max((b - low) * scale, zero), one),
            )
            share = max(min(r, g), min(max(r, g), b))  # of the second of three
            brightness = max(red / white[0], green / white[1], blue / white[2])
            balanced[y, x, 0] = (one - share) * red + share * brightness * white[0]
            balanced[y, x, 1] = (one - share) * green + share * brightness * white[1]
            balanced[y, x, 2] = (one - share) * blue + share * brightness * white[2]
