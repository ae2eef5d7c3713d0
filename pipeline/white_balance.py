"""The photograph as under one neutral light: our approaches I and II; compiled.

Source: Hui et al. 2018, supplement, white balance I and II, with matrices learnt from measured
reflectances, and colours from the layers where the flash part is of no use.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from pipeline.frames import (
    Image,
    Matrix,
    Numbers,
    Plane,
    Planes,
    by_planes,
    channels_first,
    numbers_of,
    planes_of,
)
from pipeline.lamps import Lamps
from pipeline.model import Model
from pipeline.separation import Strip
from pipeline.shares import Colour
from pipeline.spectra.matrices import best_matrix

_BRIGHTEST = 4.0
_FAINTEST = 0.02  # of a lamp's strongest channel, so that no ratio explodes
_LACKING = (0.06, 0.2)  # of the strongest channel, between which a lamp comes to have a colour
_CLIPPING = (0.9, 0.99)  # of white, between which a channel comes to count as clipped
_SINGULAR = 1e-6  # relative determinant; single precision tells less
_LONGEST = 1e30  # so that single precision holds it


class WhiteBalance:
    """Approaches I and II: colour from the flash photograph, brightness from lamps or all light.

    T_n is the matrix that takes measured reflectances best from the flash to the neutral light.
    Where the flash part is of no use colours come from each lamp's layer; what is clipped in two
    channels or three has no colour to keep, and becomes white.
    """

    def __init__(self, lamps: Lamps, model: Model) -> None:
        self._matrices = tuple(numbers_of(matrix) for matrix in lamps.matrices)
        self._to_neutral = numbers_of(model.flash_to_neutral)
        greens = whites_of(lamps, model)[:, 1]
        self._brightness = numbers_of(greens / (model.flash_to_neutral @ model.flash_white)[1])
        self._tensor = numbers_of(model.tensor)
        self._strength = float(np.linalg.norm(model.neutral))
        self._from_layers = tuple(numbers_of(one) for one in from_layers(lamps, model))
        self._white = numbers_of(neutral_white(model))

    def approach_1(self, strip: Strip) -> Image:
        """Every lamp replaced by the neutral light of the same green response.

        I = Σ_j (z_j g_j / g_n) T_n I_f, brightness z_j from the layers, g the green response of a
        white card. Returns (h, W, 3), linear camera RGB as under the neutral light, by planes.
        """
        balanced = by_planes(*strip.flash.shape)
        _by_lamps(
            planes_of(strip.flash),
            channels_first(strip.layers),
            self._matrices,
            self._brightness,
            self._to_neutral,
            planes_of(balanced),
        )
        self._finish(strip, balanced)
        return balanced

    def approach_2(self, strip: Strip) -> Image:
        """All light replaced by neutral light of the same strength ‖β‖.

        I = ‖β‖/‖b_n‖ T_n I_f, but nowhere far brighter than the photograph. Any number of lamps
        will do, since none is told from the other. Returns the same as approach_1.
        """
        balanced = by_planes(*strip.flash.shape)
        _by_strength(
            planes_of(strip.no_flash),
            planes_of(strip.flash),
            self._tensor,
            self._strength,
            self._to_neutral,
            planes_of(balanced),
        )
        self._finish(strip, balanced)
        return balanced

    def _finish(self, strip: Strip, balanced: Image) -> None:
        """Take colours from the layers where the flash part is of no use; make highlights white."""
        _finish(
            channels_first(strip.layers),
            strip.confidence,
            self._from_layers,
            self._white,
            planes_of(balanced),
        )


def whites_of(lamps: Lamps, model: Model) -> Matrix:
    """Camera RGB (N, 3) of a white card that a lamp lights like the flash does, no channel 0."""
    whites = lamps.matrices @ model.flash_white
    return np.asarray(np.maximum(whites, _FAINTEST * np.abs(whites).max(axis=1, keepdims=True)))


def from_layers(lamps: Lamps, model: Model) -> Matrix:
    """Matrices (N, 3, 3), a lamp's layer → the same under the neutral light, its green kept.

    Best for measured reflectances under the spectrum that the lamp has by its matrix, channels then
    scaled so that its white card is white. Of a lamp that lacks a colour the layer does not tell
    it either, and its channels are scaled alone (von Kries).
    """
    s, neutral = model.sensitivities, neutral_white(model)
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


def neutral_white(model: Model) -> Matrix:
    """A white card's colour (3,) under the neutral light, green 1."""
    white = model.flash_to_neutral @ model.flash_white
    return np.asarray(white / white[1])


@njit(cache=True, error_model="numpy")
def _by_lamps(
    flash: Planes,
    layers: Image,
    matrices: tuple[Numbers, ...],
    brightness: Numbers,
    n: Numbers,
    balanced: Planes,
) -> None:
    """Write Σ_j brightness_j z_j T_n I_f, z_j = layer_j · T_j I_f / ‖T_j I_f‖²."""
    zero = np.float32(0.0)
    strength = np.empty(layers.shape[3], np.float32)
    for y in range(layers.shape[2]):
        red, green, blue = flash[0][y], flash[1][y], flash[2][y]
        strength[:] = zero
        for j in range(len(layers)):
            m, scale = matrices[j], np.float32(brightness[j])
            layer_0, layer_1, layer_2 = layers[j, 0, y], layers[j, 1, y], layers[j, 2, y]
            for x in range(len(strength)):
                r, g, b = red[x], green[x], blue[x]
                p0 = max(np.float32(m[0]) * r + np.float32(m[1]) * g + np.float32(m[2]) * b, zero)
                p1 = max(np.float32(m[3]) * r + np.float32(m[4]) * g + np.float32(m[5]) * b, zero)
                p2 = max(np.float32(m[6]) * r + np.float32(m[7]) * g + np.float32(m[8]) * b, zero)
                energy = p0 * p0 + p1 * p1 + p2 * p2
                z = (p0 * layer_0[x] + p1 * layer_1[x] + p2 * layer_2[x]) / energy
                strength[x] += scale * z if energy > 0 else zero
        out_0, out_1, out_2 = balanced[0][y], balanced[1][y], balanced[2][y]
        for x in range(len(strength)):
            r, g, b = red[x], green[x], blue[x]
            lit = np.float32(n[0]) * r + np.float32(n[1]) * g + np.float32(n[2]) * b
            out_0[x] = max(strength[x] * lit, zero)
            lit = np.float32(n[3]) * r + np.float32(n[4]) * g + np.float32(n[5]) * b
            out_1[x] = max(strength[x] * lit, zero)
            lit = np.float32(n[6]) * r + np.float32(n[7]) * g + np.float32(n[8]) * b
            out_2[x] = max(strength[x] * lit, zero)


@njit(cache=True, error_model="numpy")
def _by_strength(
    no_flash: Planes, flash: Planes, d: Numbers, unit: float, m: Numbers, balanced: Planes
) -> None:
    """Write ‖β‖/unit T_n I_f; β by Cramer's rule from the columns c_j = D_j I_f, as published.

    d: (3, 3, 3) by rows, as published: channel of the result, channel of the flash part, column.
    """
    zero, faint = np.float32(0.0), np.float32(1e-9)
    strength = np.empty(flash[0].shape[1], np.float32)
    for y in range(flash[0].shape[0]):
        reds, greens, blues = flash[0][y], flash[1][y], flash[2][y]
        seen_0, seen_1, seen_2 = no_flash[0][y], no_flash[1][y], no_flash[2][y]
        for x in range(len(strength)):
            r, g, b = reds[x], greens[x], blues[x]
            n0, n1, n2 = seen_0[x], seen_1[x], seen_2[x]
            a0, b0, c0 = _columns(d[0:9], r, g, b)
            a1, b1, c1 = _columns(d[9:18], r, g, b)
            a2, b2, c2 = _columns(d[18:27], r, g, b)
            u0, u1, u2 = b1 * c2 - b2 * c1, b2 * c0 - b0 * c2, b0 * c1 - b1 * c0
            v0, v1, v2 = c1 * a2 - c2 * a1, c2 * a0 - c0 * a2, c0 * a1 - c1 * a0
            w0, w1, w2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
            determinant = abs(a0 * u0 + a1 * u1 + a2 * u2)
            squared = a0 * a0 + a1 * a1 + a2 * a2
            squared *= b0 * b0 + b1 * b1 + b2 * b2
            squared *= c0 * c0 + c1 * c1 + c2 * c2
            u = u0 * n0 + u1 * n1 + u2 * n2
            v = v0 * n0 + v1 * n1 + v2 * n2
            w = w0 * n0 + w1 * n1 + w2 * n2
            length = np.sqrt(u * u + v * v + w * w) / (determinant * np.float32(unit))
            solved = determinant > np.float32(_SINGULAR) * np.sqrt(squared)
            strength[x] = min(length, np.float32(_LONGEST)) if solved else zero
        out_0, out_1, out_2 = balanced[0][y], balanced[1][y], balanced[2][y]
        for x in range(len(strength)):
            r, g, b = reds[x], greens[x], blues[x]
            lit_0 = np.float32(m[0]) * r + np.float32(m[1]) * g + np.float32(m[2]) * b
            lit_1 = np.float32(m[3]) * r + np.float32(m[4]) * g + np.float32(m[5]) * b
            lit_2 = np.float32(m[6]) * r + np.float32(m[7]) * g + np.float32(m[8]) * b
            red, green = max(strength[x] * lit_0, zero), max(strength[x] * lit_1, zero)
            blue = max(strength[x] * lit_2, zero)
            # near-singular pixels give any length: nothing gets far brighter than the photograph
            brightest = max(max(seen_0[x], seen_1[x]), max(seen_2[x], zero))
            limit = np.float32(_BRIGHTEST) * brightest
            share = min(limit / max(max(red, green), max(blue, faint)), np.float32(1.0))
            out_0[x], out_1[x], out_2[x] = share * red, share * green, share * blue


@njit(cache=True, error_model="numpy", inline="always")
def _columns(d: Numbers, r: Any, g: Any, b: Any) -> Colour:
    """One channel of c_1, c_2, c_3."""
    return (
        np.float32(d[0]) * r + np.float32(d[3]) * g + np.float32(d[6]) * b,
        np.float32(d[1]) * r + np.float32(d[4]) * g + np.float32(d[7]) * b,
        np.float32(d[2]) * r + np.float32(d[5]) * g + np.float32(d[8]) * b,
    )


@njit(cache=True, error_model="numpy")
def _finish(
    layers: Image,
    confidence: Plane,
    matrices: tuple[Numbers, ...],
    white: Numbers,
    balanced: Planes,
) -> None:
    """Blend in the layers' colours under the neutral light, and make highlights white.

    Gains would give what is clipped the colour of no lamp. Its brightness is the least that all
    channels have, if it is white.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    w0, w1, w2 = np.float32(white[0]), np.float32(white[1]), np.float32(white[2])
    sums = np.empty((6, layers.shape[3]), np.float32)
    light_0, light_1, light_2, sum_0, sum_1, sum_2 = sums
    for y in range(layers.shape[2]):
        sums[:] = zero
        for j in range(len(layers)):
            m = matrices[j]
            layer_0, layer_1, layer_2 = layers[j, 0, y], layers[j, 1, y], layers[j, 2, y]
            for x in range(len(layer_0)):
                r, g, b = layer_0[x], layer_1[x], layer_2[x]
                light_0[x] += r
                light_1[x] += g
                light_2[x] += b
                sum_0[x] += np.float32(m[0]) * r + np.float32(m[1]) * g + np.float32(m[2]) * b
                sum_1[x] += np.float32(m[3]) * r + np.float32(m[4]) * g + np.float32(m[5]) * b
                sum_2[x] += np.float32(m[6]) * r + np.float32(m[7]) * g + np.float32(m[8]) * b
        trusted, out_0, out_1, out_2 = confidence[y], balanced[0][y], balanced[1][y], balanced[2][y]
        for x in range(len(trusted)):
            trust = trusted[x]
            red = trust * out_0[x] + (one - trust) * max(sum_0[x], zero)
            green = trust * out_1[x] + (one - trust) * max(sum_1[x], zero)
            blue = trust * out_2[x] + (one - trust) * max(sum_2[x], zero)
            r, g, b = _clipped(light_0[x]), _clipped(light_1[x]), _clipped(light_2[x])
            share = max(min(r, g), min(max(r, g), b))  # of the second of three
            brightness = max(max(red / w0, green / w1), blue / w2)
            out_0[x] = (one - share) * red + share * brightness * w0
            out_1[x] = (one - share) * green + share * brightness * w1
            out_2[x] = (one - share) * blue + share * brightness * w2


@njit(cache=True, error_model="numpy", inline="always")
def _clipped(light: np.float32) -> np.float32:
    """How far a channel counts as clipped, 0…1."""
    low, scale = np.float32(_CLIPPING[0]), np.float32(1.0 / (_CLIPPING[1] - _CLIPPING[0]))
    return min(max((light - low) * scale, np.float32(0.0)), np.float32(1.0))
