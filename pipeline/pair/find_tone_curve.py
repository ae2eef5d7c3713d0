"""Finds a camera's contrast from the pair itself, by the edges of the lamps' shadows.

Where the shadow of a lamp ends, the flash's light goes on: the flash part, what the flash
photograph has more than the other, is the same on both sides. Through a wrong curve it is not, by
the more the more the lamps' light changes. So the curve is the one through which the flash part
stays the same at the most of the places where the lamps' light does not. That edges tell a camera's
response is Lin et al.'s idea (2004, "Radiometric calibration from a single image"); that the flash
tells which, and how, is not theirs.

The change of the flash part by that of the lamps' light, both as logarithms, has a peak at 0 by the
shadows and a broad rest by paints, whose edges are in both. A mean would be drawn towards the rest,
so the curve is moved along the slope of the peak's height above its surroundings: of a narrow bell
less a wide one of the same volume, which says nothing of a rest that rises evenly.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from pipeline.arrays import Floats64
from pipeline.colour.curves import linear_to_srgb, srgb_to_linear
from pipeline.images.area_means import area_means
from pipeline.images.blocks import any_in_blocks, blocks_within
from pipeline.images.frames import Mask, Matrix, Photograph
from pipeline.pair.tone_curve import KNOTS, ToneCurve

# Chosen on development rooms (docs/trials/tone_curves.md)
_LONG_SIDE = 384
_APART = 3  # blocks
_MOST_EDGES, _FEW_EDGES = 4000, 300
_CODES = (0.06, 0.985)  # code values between which blocks tell
_LEAST_FLASH = 0.01  # of white
_LEAST_CHANGE = 0.25  # of the lamps' light, natural logarithm
_BEYOND = 0.35  # of it, on either side
_CODE_NOISE = 0.005
_CODE_POWER = 2.2  # of light over code values, about

_CONTRAST: Floats64 = np.array(
    (0.36, 0.28, 0.07, -0.18, -0.4, -0.52, -0.57, -0.56, -0.51, -0.4, 0.0)
)
"""What cameras' curves have in common: middle tones brighter, highlights flatter."""
_S_CURVE: Floats64 = np.array((0.5, 0.53, 0.43, 0.27, 0.12, 0.0, -0.09, -0.14, -0.14, -0.1, 0.0))
"""Codes moved by .05·sin 2π away from the middle."""
_CONTRAST_SPREAD, _S_SPREAD = 0.7, 1.0
_OTHER_SPREAD, _SMOOTH = 0.12, 0.25  # of what is neither, and over what codes it is alike
_STARTS = tuple(product((0.0, 0.4, 0.8, 1.2), (-0.5, 0.0, 1.0, 2.0)))
_FOLLOWED = 3
_WIDE = (0.2, 0.5)
_ROBUST, _GATE = (0.2, 0.15, 0.12, 0.1, 0.08), 0.45
_PEAKS = ((0.1, 0.25), (0.08, 0.2))
_ROBUST_STEPS, _PEAK_STEPS = 2, 6
_MOST_STEP = 0.2
_INDEPENDENT = 800.0  # edges that all together count for: neighbours say the same
_SURE, _UNLIKELY = 3.0, 15.0  # standard errors of the gain, also times its logarithm
_LEAST_USUAL = 0.01  # of the height found
_MOST_SHIFT = 0.4  # of the change of the lamps' light, that shadows have by sRGB's curve alone
_PER_PRIOR = 0.03  # of a peak's height in %


@dataclass(frozen=True)
class _Edges:
    """Blocks beside which the lamps' light changes, and the blocks beside them.

    codes, light: (4, n, 3), code values and light by sRGB's curve: without the flash on either
    side, with it on either side, in exposures of the first. knots: (4, n, 3, K), by how much each
    knot of a curve counts. balance: (3, 3), of linear sRGB of the flash photograph → as balanced as
    the other.
    """

    codes: Floats64
    light: Floats64
    knots: Floats64
    balance: Matrix


@dataclass(frozen=True)
class _Changes:
    """Of the flash part (n, 3), by that of the lamps' light; (n,) variances of them by noise."""

    off: Floats64
    variances: Floats64

    @property
    def squares(self) -> Floats64:
        return np.asarray(np.square(self.off).sum(axis=1))


def usual_contrasts() -> list[ToneCurve]:
    """What cameras' contrasts are about, and none: where the search for one starts."""
    return [ToneCurve(contrast * _CONTRAST + s * _S_CURVE) for contrast, s in _STARTS]


def find_tone_curve(
    no_flash: Photograph,
    flash: Photograph,
    unusable: Mask,
    ratio: float,
    balance: Matrix | None = None,
) -> ToneCurve | None:
    """The curve through which the flash's light does not end where the lamps' does.

    None where there are too few edges of shadows to tell, or sRGB's own curve does as well.

    Parameters
    ----------
    no_flash, flash : (H, W, 3), linear by sRGB's curve, 1.0 = white, aligned, the flash photograph
        with the lamps' light in it
    unusable : (H, W), what tells nothing of light
    ratio : of the exposures, flash photograph ÷ other
    balance : (3, 3), of linear sRGB of the flash photograph → as balanced as the other
    """
    edges = _edges(no_flash, flash, unusable, ratio, np.eye(3) if balance is None else balance)
    if edges is None:
        return None
    none = np.zeros(len(KNOTS))
    starts = [curve.logs for curve in usual_contrasts()]
    usual = _height(edges, none, _PEAKS[0])
    if max(_height(edges, logs, _PEAKS[0]) for logs in starts) <= max(usual, 0.0):
        return None  # most of all where sRGB's curve is all that there is: saves two thirds
    starts.sort(key=lambda logs: _height(edges, logs, _WIDE), reverse=True)
    prior = np.linalg.inv(_covariance()).astype(np.float64)
    found = [_followed(edges, logs, prior) for logs in starts[:_FOLLOWED]]
    costs = [float(logs @ prior @ logs) for logs in found]
    heights = [_height(edges, logs, _PEAKS[0]) for logs in found]
    best = int(np.argmax(np.array(heights) - _PER_PRIOR * np.array(costs)))
    in_peak = np.maximum(_bells(edges, found[best], _PEAKS[0]), 0.0)
    apart = np.sqrt(_changes(edges, none).squares / 3)
    shift = float(in_peak @ apart / max(in_peak.sum(), 1e-30))
    gain = _bells(edges, found[best], _PEAKS[0]) - _bells(edges, none, _PEAKS[0])
    sure = gain.sum() / np.sqrt(np.square(gain).sum() + 1e-30)
    times = heights[best] / max(usual, _LEAST_USUAL * heights[best])
    if (
        heights[best] <= max(usual, 0.0)
        or sure < _SURE
        or sure * np.log(times) < _SURE
        or shift > _MOST_SHIFT
        or costs[best] > _UNLIKELY
        or (np.diff(srgb_to_linear(KNOTS) * np.exp(found[best])) <= 0).any()
    ):
        return None
    return ToneCurve(found[best])


def _edges(
    no_flash: Photograph, flash: Photograph, unusable: Mask, ratio: float, balance: Matrix
) -> _Edges | None:
    """None where there are too few."""
    height, width = unusable.shape
    blocks = blocks_within(width, height, _LONG_SIDE)
    means = (area_means(image, blocks.size, blocks.crop) for image in (no_flash, flash))
    both = linear_to_srgb(np.clip(np.stack([*means]), 0.0, 1.0)).astype(np.float64)
    known = ~any_in_blocks(unusable, blocks.side)
    known &= (both.min(axis=(0, 3)) > _CODES[0]) & (both.max(axis=(0, 3)) < _CODES[1])
    found = [_steps(both, known), _steps(both.transpose(0, 2, 1, 3), known.T)]
    codes = np.concatenate(found, axis=1)
    light = srgb_to_linear(codes) / np.array((1.0, 1.0, ratio, ratio))[:, None, None]
    parts = light[2:] @ balance.T - light[:2]
    which = np.flatnonzero(parts.min(axis=(0, 2)) > _LEAST_FLASH)
    if len(which) < _FEW_EDGES:
        return None
    if len(which) > _MOST_EDGES:
        which = which[np.linspace(0, len(which) - 1, _MOST_EDGES).astype(int)]
    codes, light = codes[:, which], light[:, which]
    places = codes[..., None] * (len(KNOTS) - 1) - np.arange(len(KNOTS))
    return _Edges(codes, light, np.maximum(1.0 - np.abs(places), 0.0), balance)


def _steps(both: Floats64, known: Mask) -> Floats64:
    """Code values (4, n, 3) on either side of steps down the rows, as in _Edges.

    both: (2, h, w, 3), code values without and with the flash. known: (h, w). At a step the lamps'
    light changes, and far less beyond it.
    """
    rows = max(len(known) - 3 * _APART, 0)
    at = [slice(k * _APART, k * _APART + rows) for k in range(4)]
    logs = np.log(srgb_to_linear(np.maximum(both[0], _CODES[0]))).mean(axis=2)
    before, change, after = (np.abs(logs[at[k + 1]] - logs[at[k]]) for k in range(3))
    there = known[at[0]] & known[at[1]] & known[at[2]] & known[at[3]]
    there &= (change > _LEAST_CHANGE) & (np.maximum(before, after) < _BEYOND * change)
    sides = np.stack([both[0, at[1]], both[0, at[2]], both[1, at[1]], both[1, at[2]]])
    return np.asarray(sides[:, there])


def _covariance() -> Floats64:
    """Of the logarithms that make up a curve: contrast, an S, and what is smooth."""
    smooth = np.exp(-0.5 * np.square((KNOTS[:, None] - KNOTS) / _SMOOTH))
    smooth = smooth - smooth[-1:] - smooth[:, -1:] + 1.0  # at white nothing varies
    kinds = _CONTRAST_SPREAD * _CONTRAST, _S_SPREAD * _S_CURVE
    known = sum(np.outer(kind, kind) for kind in kinds)
    return np.asarray(known + _OTHER_SPREAD**2 * smooth + 1e-6 * np.eye(len(KNOTS)))


def _lights(edges: _Edges, logs: Floats64) -> tuple[Floats64, Floats64, Floats64]:
    """Light (4, n, 3) through a curve, flash parts (2, n, 3), changes (n,) of the lamps' light."""
    light = edges.light * np.exp(edges.knots @ logs)
    parts = np.maximum(light[2:] @ edges.balance.T - light[:2], 1e-4)
    changes = np.sqrt(np.square(np.log(light[0] / light[1])).mean(axis=1)) + 1e-3
    return light, parts, changes


def _changes(edges: _Edges, logs: Floats64) -> _Changes:
    light, parts, changes = _lights(edges, logs)
    noise = np.square(light * (_CODE_POWER * _CODE_NOISE) / edges.codes)
    relative = ((noise[:2] + noise[2:]) / np.square(parts)).sum(axis=0).mean(axis=1)
    return _Changes(np.log(parts[0] / parts[1]) / changes[:, None], relative / np.square(changes))


def _slopes(edges: _Edges, logs: Floats64) -> Floats64:
    """Change of _Changes.off by the logarithms of a curve, (n, 3, K)."""
    light, parts, changes = _lights(edges, logs)
    by = light[..., None] * edges.knots
    by = (edges.balance @ by[2:] - by[:2]) / parts[..., None]
    return np.asarray((by[0] - by[1]) / changes[:, None, None])


def _height(edges: _Edges, logs: Floats64, widths: tuple[float, float]) -> float:
    """Height of the peak above its surroundings, in % of the edges."""
    return float(_bells(edges, logs, widths).sum())


def _bells(edges: _Edges, logs: Floats64, widths: tuple[float, float]) -> Floats64:
    """What each edge (n,) gives to the height of the peak."""
    changes = _changes(edges, logs)
    weights = _weights(changes, widths[0])
    narrow, wide = (np.exp(-changes.squares / (2 * width**2)) for width in widths)
    return np.asarray(100 * weights * (narrow - _volume(widths) * wide) / weights.sum())


def _weights(changes: _Changes, width: float) -> Floats64:
    """Lower where noise is more than a bell is wide."""
    return np.asarray((1.0 + changes.variances / width**2) ** -1.5)


def _volume(widths: tuple[float, float]) -> float:
    return (widths[0] / widths[1]) ** 3


def _followed(edges: _Edges, logs: Floats64, prior: Floats64) -> Floats64:
    """Follow a curve: first robustly to the peak, then up to its height."""
    for scale in _ROBUST:
        for _ in range(_ROBUST_STEPS):
            changes = _changes(edges, logs)
            variances = changes.variances + scale**2
            weights = 1.0 / (variances * np.square(1.0 + changes.squares / (3 * variances)))
            weights *= changes.squares < 3 * _GATE**2
            logs = logs + _step(edges, logs, changes, weights, weights, prior)
    for widths in _PEAKS:
        for _ in range(_PEAK_STEPS):
            changes = _changes(edges, logs)
            weights = 2.0 * _weights(changes, widths[0])
            narrow, wide = (
                weights * np.exp(-changes.squares / (2 * width**2)) / width**2 for width in widths
            )
            around = narrow - _volume(widths) * wide
            logs = logs + _step(edges, logs, changes, narrow, around, prior)
    return logs


def _step(
    edges: _Edges,
    logs: Floats64,
    changes: _Changes,
    curvature: Floats64,
    weights: Floats64,
    prior: Floats64,
) -> Floats64:
    """A Gauss–Newton step: uphill by weights (n,), as far as curvature (n,) > 0 allows."""
    slopes = _slopes(edges, logs).reshape(-1, len(KNOTS))
    each = _INDEPENDENT / len(weights)
    matrix = (slopes * np.repeat(each * curvature, 3)[:, None]).T @ slopes + prior
    uphill = slopes.T @ (each * weights[:, None] * changes.off).ravel() + prior @ logs
    return np.asarray(np.clip(np.linalg.solve(matrix, -uphill), -_MOST_STEP, _MOST_STEP))
