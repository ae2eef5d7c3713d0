"""The photograph as under one neutral light: our approaches I and II; compiled.

Source: Hui et al. 2018, supplement, white balance I and II, with matrices learnt from measured
reflectances, colours from the layers where the flash part is of no use, and the strength of all
light held to von Kries's where saturated colours do not tell it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.compiling import compiled
from pipeline.images.by_matrix import fused_by_matrix
from pipeline.images.frames import (
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
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.pictures.clipped import no_rim, whitening
from pipeline.separation.separation import Strip
from pipeline.spectra.matrices import best_matrix

_BRIGHTEST = 4.0  # times the pixel's light
_FAINTEST = 0.02  # of a lamp's strongest channel, so that no ratio explodes
_LACKING = (0.06, 0.2)  # of the strongest channel, between which a lamp comes to have a colour
_HOLD = 0.05  # of the equations' own size, by which β is held to von Kries's
_FAINT = 0.1  # of the flash part, below which a channel no longer tells von Kries's light
_LEAST = 1e-30  # of what is divided by, so that single precision holds the result


class _Neutral(NamedTuple):
    """What lamps, model and neutral light are to the compiled loops, numbers row by row.

    to_neutral: T_n. matrices, brightness, from_layers: of each lamp, T_j, g_j / g_n, and the matrix
    of from_layers. columns: (3, 3, 3), D_j: channel of the result, column, channel of the flash
    part. card: a white card's colour (3,) under the flash. strength: ‖b_n‖. white: a white card's
    colour (3,) under the neutral light, green 1. clipping: as of WhiteBalance.
    """

    to_neutral: Numbers
    matrices: tuple[Numbers, ...]
    brightness: Numbers
    from_layers: tuple[Numbers, ...]
    columns: Numbers
    card: Numbers
    strength: float
    white: Numbers
    clipping: float


class WhiteBalance:
    """Approaches I and II: colour from the flash photograph, brightness from lamps or all light.

    T_n is the matrix that takes measured reflectances best from the flash to the neutral light.
    Where the flash part is of no use colours come from each lamp's layer; what is clipped is
    white where nothing tells its colour, and has no pink rim (pipeline.pictures.clipped).

    clipping: the value at which highlights are clipped, infinite where none is (Pair.clipping).
    """

    def __init__(self, lamps: Lamps, model: Model, clipping: float) -> None:
        greens = whites_of(lamps, model)[:, 1]
        self._neutral = _Neutral(
            to_neutral=numbers_of(model.flash_to_neutral),
            matrices=tuple(numbers_of(matrix) for matrix in lamps.matrices),
            brightness=numbers_of(greens / (model.flash_to_neutral @ model.flash_white)[1]),
            from_layers=tuple(numbers_of(one) for one in from_layers(lamps, model)),
            columns=numbers_of(model.tensor.transpose(0, 2, 1)),
            card=numbers_of(model.flash_white),
            strength=float(np.linalg.norm(model.neutral)),
            white=numbers_of(neutral_white(model)),
            clipping=clipping,
        )

    def of(self, strip: Strip, first: bool, second: bool) -> tuple[Image | None, Image | None]:
        """Both approaches where wanted, (h, W, 3) linear camera RGB under the neutral light.

        I, every lamp replaced by the neutral light of the same green response: Σ_j (z_j g_j / g_n)
        T_n I_f, brightness z_j from the layers, g the green response of a white card. II, all light
        replaced by neutral light of the same strength: ‖β‖/‖b_n‖ T_n I_f, but nowhere far brighter
        than the photograph. Any number of lamps will do for II, since none is told from the other.
        Both lie in memory by planes.
        """
        if not (first or second):
            return None, None
        shape = strip.flash.shape
        balanced_1 = by_planes(*shape) if first else by_planes(0, *shape[1:])
        balanced_2 = by_planes(*shape) if second else by_planes(0, *shape[1:])
        _balance(
            planes_of(strip.no_flash),
            planes_of(strip.flash),
            channels_first(strip.layers),
            strip.confidence,
            self._neutral,
            planes_of(balanced_1),
            planes_of(balanced_2),
        )
        return balanced_1 if first else None, balanced_2 if second else None


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
    s, neutral = model.camera.sensitivities, neutral_white(model)
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


@compiled
def _balance(
    no_flash: Planes,
    flash: Planes,
    layers: Image,
    confidence: Plane,
    neutral: _Neutral,
    first: Planes,
    second: Planes,
) -> None:
    """Write approaches I and II; one without rows is not wanted.

    Row by row, so that what both need is computed once and stays in the cache, and in short loops:
    one long loop takes longer.
    """
    rows, width = layers.shape[2:]
    scratch = np.empty((8, width), np.float32)
    lit, filled = (scratch[0], scratch[1], scratch[2]), (scratch[3], scratch[4], scratch[5])
    whitened, strength = scratch[6], scratch[7]
    for y in range(rows):
        part, trust = (flash[0][y], flash[1][y], flash[2][y]), confidence[y]
        _light(part, neutral.to_neutral, lit)
        _fill(layers, y, trust, neutral, filled, whitened)
        if len(first[0]) > 0:
            _by_lamps(part, layers, y, neutral.matrices, neutral.brightness, strength)
            out = first[0][y], first[1][y], first[2][y]
            _finish(lit, strength, trust, filled, whitened, neutral.white, out)
        if len(second[0]) > 0:
            seen = no_flash[0][y], no_flash[1][y], no_flash[2][y]
            _by_strength(seen, part, lit, neutral, strength)
            out = second[0][y], second[1][y], second[2][y]
            _finish(lit, strength, trust, filled, whitened, neutral.white, out)


@compiled
def _light(flash: Planes, m: Numbers, lit: Planes) -> None:
    """Write T_n I_f of a row."""
    reds, greens, blues = flash
    lit_0, lit_1, lit_2 = lit
    for x in range(len(reds)):
        lit_0[x], lit_1[x], lit_2[x] = fused_by_matrix(m, reds[x], greens[x], blues[x])


@compiled
def _fill(
    layers: Image,
    y: int,
    confidence: Plane,
    neutral: _Neutral,
    filled: Planes,
    whitened: Plane,
) -> None:
    """Write what the layers' colours under the neutral light add to a row, and its highlights.

    filled: as far as the flash part is not trusted. whitened: 0…1, how far a pixel is to be white.
    """
    zero, one, of_clipping = np.float32(0.0), np.float32(1.0), np.float32(1.0 / neutral.clipping)
    white, matrices = neutral.white, neutral.from_layers
    w0, w1, w2 = np.float32(white[0]), np.float32(white[1]), np.float32(white[2])
    inverse_0, inverse_1, inverse_2 = one / w0, one / w1, one / w2
    filled_0, filled_1, filled_2 = filled
    for x in range(len(confidence)):
        r = g = b = p0 = p1 = p2 = zero
        for j in range(len(matrices)):
            red, green, blue = layers[j, 0, y, x], layers[j, 1, y, x], layers[j, 2, y, x]
            q0, q1, q2 = fused_by_matrix(matrices[j], red, green, blue)
            r, g, b = r + red, g + green, b + blue
            p0, p1, p2 = p0 + q0, p1 + q1, p2 + q2
        p0, p1, p2 = max(p0, zero) * inverse_0, max(p1, zero) * inverse_1, max(p2, zero) * inverse_2
        rest = one - confidence[x]
        light = r * of_clipping, g * of_clipping, b * of_clipping
        p0, p1, p2 = no_rim(light, (p0, p1, p2))
        filled_0[x], filled_1[x], filled_2[x] = rest * w0 * p0, rest * w1 * p1, rest * w2 * p2
        whitened[x] = whitening(light, (p0, p1, p2))


@compiled
def _by_lamps(
    flash: Planes,
    layers: Image,
    y: int,
    matrices: tuple[Numbers, ...],
    brightness: Numbers,
    strength: Plane,
) -> None:
    """Write Σ_j brightness_j z_j of a row, z_j = layer_j · T_j I_f / ‖T_j I_f‖²."""
    zero = np.float32(0.0)
    reds, greens, blues = flash
    for x in range(len(strength)):
        r, g, b = reds[x], greens[x], blues[x]
        total = zero
        for j in range(len(matrices)):
            p0, p1, p2 = fused_by_matrix(matrices[j], r, g, b)
            p0, p1, p2 = max(p0, zero), max(p1, zero), max(p2, zero)
            energy = p0 * p0 + p1 * p1 + p2 * p2
            power = p0 * layers[j, 0, y, x] + p1 * layers[j, 1, y, x] + p2 * layers[j, 2, y, x]
            total += np.float32(brightness[j]) * (power / energy) if energy > 0 else zero
        strength[x] = total


@compiled
def _by_strength(
    no_flash: Planes,
    flash: Planes,
    lit: Planes,
    neutral: _Neutral,
    strength: Plane,
) -> None:
    """Write ‖β‖/‖b_n‖ of a row; β that comes nearest to Σ_j β_j c_j = I_nf, c_j = D_j I_f.

    Saturated colours leave β next to free, so that each of its channels is held to what von Kries
    makes of it, as far as the flash part has that channel: least squares, by Cramer's rule.
    lit: T_n I_f, which the strength is not to make far brighter than the photograph.
    """
    d, card = neutral.columns, neutral.card
    zero, one, least = np.float32(0.0), np.float32(1.0), np.float32(_LEAST)
    hold, faint = np.float32(_HOLD * _HOLD / 3.0), np.float32(_FAINT * _FAINT)
    w0, w1, w2 = np.float32(card[0]), np.float32(card[1]), np.float32(card[2])
    reds, greens, blues = flash
    seen_0, seen_1, seen_2 = no_flash
    lit_0, lit_1, lit_2 = lit
    for x in range(len(strength)):
        r, g, b = reds[x], greens[x], blues[x]
        n0, n1, n2 = seen_0[x], seen_1[x], seen_2[x]
        inverse = one / np.sqrt(max(r * r + g * g + b * b, least))
        r, g, b = r * inverse, g * inverse, b * inverse
        a0, b0, c0 = fused_by_matrix(d[0:9], r, g, b)
        a1, b1, c1 = fused_by_matrix(d[9:18], r, g, b)
        a2, b2, c2 = fused_by_matrix(d[18:27], r, g, b)
        aa, bb = a0 * a0 + a1 * a1 + a2 * a2, b0 * b0 + b1 * b1 + b2 * b2
        cc = c0 * c0 + c1 * c1 + c2 * c2
        ab, ac = a0 * b0 + a1 * b1 + a2 * b2, a0 * c0 + a1 * c1 + a2 * c2
        bc = b0 * c0 + b1 * c1 + b2 * c2
        weight = hold * (aa + bb + cc)
        p0 = a0 * n0 + a1 * n1 + a2 * n2 + weight * (w0 * n0 * r / max(r * r, faint))
        p1 = b0 * n0 + b1 * n1 + b2 * n2 + weight * (w1 * n1 * g / max(g * g, faint))
        p2 = c0 * n0 + c1 * n1 + c2 * n2 + weight * (w2 * n2 * b / max(b * b, faint))
        aa, bb, cc = aa + weight, bb + weight, cc + weight
        u, v, w = bb * cc - bc * bc, ac * bc - ab * cc, ab * bc - ac * bb
        determinant = aa * u + ab * v + ac * w
        beta_0 = u * p0 + v * p1 + w * p2
        beta_1 = v * p0 + (aa * cc - ac * ac) * p1 + (ab * ac - aa * bc) * p2
        beta_2 = w * p0 + (ab * ac - aa * bc) * p1 + (aa * bb - ab * ab) * p2
        length = np.sqrt(beta_0 * beta_0 + beta_1 * beta_1 + beta_2 * beta_2) * inverse
        length /= max(determinant, least) * np.float32(neutral.strength)
        # noise of faint channels gives any length
        limit = np.float32(_BRIGHTEST) * max(max(n0, n1), max(n2, zero))
        limit /= max(max(lit_0[x], lit_1[x]), max(lit_2[x], least))
        strength[x] = min(length, limit)


@compiled
def _finish(
    lit: Planes,
    strength: Plane,
    confidence: Plane,
    filled: Planes,
    whitened: Plane,
    white: Numbers,
    balanced: Planes,
) -> None:
    """Write strength T_n I_f of a row, the layers' colours blended in, and highlights white.

    Gains would give what is clipped the colour of no lamp. Its brightness is the least that all
    channels have, if it is white.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    w0, w1, w2 = np.float32(white[0]), np.float32(white[1]), np.float32(white[2])
    inverse_0, inverse_1, inverse_2 = one / w0, one / w1, one / w2
    lit_0, lit_1, lit_2 = lit
    filled_0, filled_1, filled_2 = filled
    out_0, out_1, out_2 = balanced
    for x in range(len(confidence)):
        trust, scale = confidence[x], strength[x]
        red = trust * max(scale * lit_0[x], zero) + filled_0[x]
        green = trust * max(scale * lit_1[x], zero) + filled_1[x]
        blue = trust * max(scale * lit_2[x], zero) + filled_2[x]
        brightness = max(max(red * inverse_0, green * inverse_1), blue * inverse_2)
        brightness, rest = whitened[x] * brightness, one - whitened[x]
        out_0[x] = rest * red + brightness * w0
        out_1[x] = rest * green + brightness * w1
        out_2[x] = rest * blue + brightness * w2
