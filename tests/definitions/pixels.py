"""What is compiled in the pipeline for pixels, in plain NumPy: slower, and easier to read.

Tests hold the compiled loops against these definitions.
"""

from __future__ import annotations

from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.images.frames import Image
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.matrixfit.deviations import Deviations, monomials
from pipeline.separation.proportions import predictions
from pipeline.separation.separation import Strip

_REGULAR = 1e-6
_RADIUS, _EPSILON, _TOLERANCE = 4, 1e-4, 0.25
_WELL, _KNOWN = 0.7, 0.2
_BRIGHTEST, _HOLD, _FAINT = 4.0, 0.05, 0.1


def shares(no_flash: Floats, predictions: Floats) -> Floats32:
    """pipeline.light.shares.shares: the best of all subsets' solutions that are ≥ 0, (N, ...)."""
    count = len(predictions)
    gram = {
        (i, j): _dot(predictions[i], predictions[j]) for i in range(count) for j in range(i, count)
    }
    seen = [_dot(predictions[j], no_flash) for j in range(count)]
    best = np.zeros((count, *no_flash.shape[:-1]), dtype=np.float32)
    gain = np.zeros(no_flash.shape[:-1])
    for size in range(1, count + 1):
        for subset in combinations(range(count), size):
            solution = _solve(subset, gram, seen)
            # ‖I‖² − ‖I − Pz‖² at the least squares solution
            explained = sum(z * seen[j] for j, z in zip(subset, solution, strict=True))
            better = (explained > gain) & np.logical_and.reduce([z >= 0 for z in solution])
            gain = np.where(better, explained, gain)
            for j in range(count):
                value = solution[subset.index(j)] if j in subset else 0.0
                best[j] = np.where(better, value, best[j])
    return best


def _solve(
    subset: tuple[int, ...], gram: dict[tuple[int, int], Floats64], seen: list[Floats64]
) -> list[Floats64]:
    """Least squares for some of the lamps; −1 where they cannot be told apart."""
    if len(subset) == 1:
        (a,) = subset
        return [_divide(seen[a], gram[a, a], gram[a, a] > 0)]
    if len(subset) == 2:
        a, b = subset
        determinant = gram[a, a] * gram[b, b] - gram[a, b] ** 2
        regular = determinant > _REGULAR * gram[a, a] * gram[b, b]
        return [
            _divide(gram[b, b] * seen[a] - gram[a, b] * seen[b], determinant, regular),
            _divide(gram[a, a] * seen[b] - gram[a, b] * seen[a], determinant, regular),
        ]
    cofactor = {
        (0, 0): gram[1, 1] * gram[2, 2] - gram[1, 2] ** 2,
        (0, 1): gram[0, 2] * gram[1, 2] - gram[0, 1] * gram[2, 2],
        (0, 2): gram[0, 1] * gram[1, 2] - gram[0, 2] * gram[1, 1],
        (1, 1): gram[0, 0] * gram[2, 2] - gram[0, 2] ** 2,
        (1, 2): gram[0, 1] * gram[0, 2] - gram[0, 0] * gram[1, 2],
        (2, 2): gram[0, 0] * gram[1, 1] - gram[0, 1] ** 2,
    }
    determinant = np.stack([gram[0, j] * cofactor[0, j] for j in range(3)]).sum(axis=0)
    regular = determinant > _REGULAR**1.5 * gram[0, 0] * gram[1, 1] * gram[2, 2]
    return [
        _divide(
            np.stack([cofactor[min(i, j), max(i, j)] * seen[j] for j in range(3)]).sum(axis=0),
            determinant,
            regular,
        )
        for i in range(3)
    ]


def _dot(a: Floats, b: Floats) -> Floats64:
    """Sum over the channels, in double precision: lamps that look alike at a pixel need it."""
    return np.asarray(np.multiply(a, b, dtype=np.float64).sum(axis=-1))


def _divide(numerator: Floats64, denominator: Floats64, regular: NDArray[np.bool_]) -> Floats64:
    return np.where(regular, numerator / np.where(regular, denominator, 1.0), -1.0)


def model_proportions(no_flash: Image, flash: Image, lamps: Lamps) -> Floats32:
    """pipeline.separation.proportions.model_proportions, (N, h, W, 3)."""
    predicted = light_of_lamps(flash, lamps)
    weights = lamps.channel_weights.astype(np.float32)
    z = shares(no_flash * weights, predicted * weights)
    parts = predicted * z[..., None]
    return normalised(parts)


def light_of_lamps(flash: Image, lamps: Lamps) -> Floats32:
    """What lamps give where they shine like the flash, with their deviations, (N, h, W, 3), ≥ 0."""
    by_matrix = np.einsum("nkl,hwl->nhwk", lamps.matrices.astype(np.float32), flash)
    lit = by_matrix + deviating_light(flash, lamps.deviations)
    return np.asarray(np.maximum(lit, np.float32(0.0)))


def deviating_light(flash: Floats, deviations: Deviations) -> Floats32:
    """s · p(q) of flash colours (..., 3), to be added to T I_flash: (N, ..., 3), any sign."""
    total = flash.sum(axis=-1, dtype=np.float64)
    chromaticity = flash[..., :2] / np.where(total > 0, total, 1.0)[..., None]
    powers = monomials((chromaticity - deviations.centre) / deviations.spread)
    own = np.einsum("jkm,...m->j...k", deviations.terms, powers)
    return np.asarray(own * np.maximum(total, 0.0)[..., None], dtype=np.float32)


def normalised(parts: Floats32) -> Floats32:
    """Parts of the whole, (N, h, W, 3), 0…1, summing to 1 in each channel.

    parts: each lamp's light, ≥ 0. Where a channel has none, the parts of the pixel's whole light
    are taken, and equal ones where there is no light at all.
    """
    total = parts.sum(axis=0)
    whole = parts.sum(axis=-1)
    whole_total = whole.sum(axis=0)
    equal = np.float32(1.0 / len(parts))
    overall = np.where(whole_total > 0, whole / np.where(whole_total > 0, whole_total, 1), equal)
    return np.where(total > 0, parts / np.where(total > 0, total, 1), overall[..., None])


def smooth_proportions(
    proportions: Floats32,
    no_flash: Image,
    flash: Image,
    trust: Floats32,
    uncertainty: Floats32,
    keep: slice,
) -> Floats32:
    """pipeline.separation.smoothing.smooth_proportions: a guided filter per lamp and channel."""
    if len(proportions) == 1:
        return proportions[:, keep]
    light, flashed = (np.maximum(image.sum(axis=2), 0.0) for image in (no_flash, flash))
    guide = light / np.maximum(light + flashed, 1e-9)
    weight = trust + np.float32(1e-6)
    total = _box(weight)
    mean = _box(weight * guide) / total
    variance = np.maximum(_box(weight * guide * guide) / total - mean * mean, 0.0)
    smooth = np.empty((len(proportions), *proportions[0, keep].shape), dtype=np.float32)
    for lamp, one in enumerate(proportions):
        for channel in range(3):
            p = one[..., channel]
            p_mean = _box(weight * p) / total
            slope = (_box(weight * guide * p) / total - mean * p_mean) / (variance + _EPSILON)
            offset = p_mean - slope * mean
            fitted = (_box(weight * slope) * guide + _box(weight * offset)) / total
            smooth[lamp, ..., channel] = np.clip(fitted[keep], 0.0, 1.0)
    smooth /= np.maximum(smooth.sum(axis=0), 1e-6)
    change = smooth - proportions[:, keep]
    noise = np.square(uncertainty[keep])
    largest = np.square(_TOLERANCE * np.abs(change).max(axis=(0, 3)))
    share = noise / np.maximum(noise + largest, 1e-12)
    return np.asarray(proportions[:, keep] + share[..., None] * change)


def _box(plane: Floats32) -> Floats32:
    mean = cv2.blur(plane, (2 * _RADIUS + 1, 2 * _RADIUS + 1), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(mean, dtype=np.float32)


def place_flash(no_flash: Image, flash: Image, placed: Floats, confidence: Floats) -> Image:
    """pipeline.pair.placing.place_flash: flash regressed on no-flash around each pixel."""
    out = flash.astype(np.float64)
    for y, x in np.argwhere(placed < _WELL):
        near, distance = _around(placed.shape, y, x, 2)
        weight = np.exp(-distance / 2.0) * np.maximum(placed[near], 0.05)
        weight *= confidence[near] + 1e-6
        steps = no_flash[near].reshape(-1, 3).astype(np.float64) - no_flash[y, x]
        mean = np.average(steps, axis=0, weights=weight.ravel())
        spread = np.cov(steps.T, aweights=weight.ravel(), ddof=0)
        spread += np.eye(3) * (1e-4 * np.square(no_flash[y, x] + mean).sum() + 1e-14)
        pull = 1.0 - (steps - mean) @ np.linalg.solve(spread, mean)
        regressed = (weight.ravel() * pull) @ flash[near].reshape(-1, 3) / weight.sum()
        out[y, x] += (1.0 - placed[y, x] / _WELL) * (np.maximum(regressed, 0.0) - out[y, x])
    return out.astype(np.float32)


def mend_proportions(
    smooth: Floats32,
    proportions: Floats32,
    photograph: Image,
    variance: Floats64,
    placed: Floats,
    confidence: Floats,
) -> tuple[Floats32, Floats64]:
    """pipeline.pair.placing.mend_proportions; variance: (h, W), of the photograph's sum."""
    out, trust = smooth.astype(np.float64), confidence.astype(np.float64)
    worth = np.minimum(placed / _WELL, confidence / _KNOWN)
    for y, x in np.argwhere(worth < 1.0):
        near, distance = _around(placed.shape, y, x, 4)
        own = photograph[y, x].astype(np.float64)
        unlike = np.square(photograph[near] - own).sum(axis=-1)
        unlike /= 2 * 0.07**2 * np.square(own).sum() + 2 * variance[y, x] + 1e-12
        weight = np.exp(-distance / 8.0) * placed[near] * confidence[near] / (1 + unlike) ** 2
        if weight.sum() > 0:
            mean = np.einsum("hw,nhwk->nk", weight, proportions[:, *near]) / weight.sum()
            share = (1.0 - worth[y, x]) * min(weight.sum() / 0.1, 1.0)
            out[:, y, x] += share * (mean - out[:, y, x])
            trust[y, x] += share * (1.0 - trust[y, x])
    return out.astype(np.float32), trust


def _around(
    shape: tuple[int, ...], y: int, x: int, reach: int
) -> tuple[tuple[slice, slice], Floats64]:
    """The pixels around one, as far as the picture goes, and their squared distances from it."""
    rows = slice(max(y - reach, 0), min(y + reach + 1, shape[0]))
    columns = slice(max(x - reach, 0), min(x + reach + 1, shape[1]))
    down, right = np.arange(rows.start, rows.stop) - y, np.arange(columns.start, columns.stop) - x
    return (rows, columns), np.add.outer(down**2, right**2).astype(np.float64)


def approach_1(strip: Strip, lamps: Lamps, greens: Floats64, to_neutral: Floats64) -> Image:
    """Σ_j greens_j z_j T_n I_f, greens those of white cards against the neutral light's."""
    predicted = predictions(strip.flash, lamps)
    energy = (predicted * predicted).sum(axis=3)
    z = np.where(energy > 0, (strip.layers * predicted).sum(axis=3) / np.maximum(energy, 1e-30), 0)
    brightness = np.einsum("nhw,n->hw", z, greens)
    neutral = np.maximum(brightness[..., None] * (strip.flash @ to_neutral.T), 0.0)
    return np.asarray(neutral, dtype=np.float32)


def approach_2(strip: Strip, model: Model, to_neutral: Floats64) -> Image:
    """‖β‖/‖b_n‖ T_n I_f, at most four times as bright as the photograph.

    β has the least ‖C β − I_nf‖² + (.05 ‖C‖)²/3 ‖β − β_k‖², with columns D_j I_f in C; β_k is von
    Kries's, a channel of I_nf ÷ the same of I_f, this at least .1 of all, on a white card.
    """
    flash, no_flash = strip.flash.astype(np.float64), strip.no_flash.astype(np.float64)
    columns = np.einsum("klj,...l->...kj", model.tensor, flash)
    faint = _FAINT**2 * (flash * flash).sum(axis=2, keepdims=True)
    kries = model.flash_white * no_flash * flash / np.maximum(np.maximum(flash**2, faint), 1e-30)
    weight = _HOLD**2 / 3 * (columns**2).sum(axis=(2, 3))[..., None]
    held = np.swapaxes(columns, 2, 3) @ columns + (weight + 1e-30)[..., None] * np.eye(3)
    asked = np.einsum("...kj,...k->...j", columns, no_flash) + weight * kries
    beta = np.linalg.solve(held, asked[..., None])[..., 0]
    strength = np.linalg.norm(beta, axis=2) / np.linalg.norm(model.neutral)
    neutral = np.maximum(strength[..., None] * (strip.flash @ to_neutral.T), 0.0)
    limit = _BRIGHTEST * np.maximum(strip.no_flash.max(axis=2, keepdims=True), 0.0)
    gain = np.minimum(1.0, limit / np.maximum(neutral.max(axis=2, keepdims=True), 1e-9))
    return np.asarray(neutral * gain, dtype=np.float32)
