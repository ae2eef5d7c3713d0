"""How many lamps a pair needs: by how much better one more explains it.

A second lamp earns its place by the likelihood that it gains. A third is told by that gain, too,
and by differences across the edges of shadows: with two lamps, nearly all show one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.matrixfit.evidence import Data, Evidence
from pipeline.matrixfit.fit import Fit
from pipeline.reduced import ReducedPair
from pipeline.shares import shares

Array = NDArray[np.float64]

# Measured on development scenes, exact and noisy: a second lamp that is not there gains at most
# 173, one that is gains 462 and more; evidence of a third is at most 1.2 and at least 2.1
_SECOND_LAMP = 300.0
_THIRD_LAMP, _THIRD_GAIN, _THIRD_OFF = 1.6, 150.0, 0.125
_SECOND_STEEPNESS, _THIRD_STEEPNESS = 4.0, 3.0
_OFF, _OUTSIDE = 0.03, 0.005  # chromaticity, beyond two standard deviations
# three lamps give at most 1.5, ten of twelve scenes with four more
_FOURTH_LAMP, _FOURTH_LEFT, _FOURTH_OFF, _FOURTH_OUTSIDE = 1.45, 0.01, 0.4, 0.1
_UNSURE = 0.3
_QUANTILE = 0.9


@dataclass(frozen=True)
class Count:
    """number: of lamps, 1 to 3. confidence: 0…1 that it is right. more: signs of a fourth."""

    number: int
    confidence: float
    more: bool


def count_lamps(reduced: ReducedPair, evidence: Evidence, fit: Callable[[int], Fit]) -> Count:
    """Count the lamps of a pair. fit: gives the best fit of a number of lamps, 1 to 3."""
    gain = max(fit(1).cost - fit(2).cost, 1.0)
    several = _logistic(_SECOND_STEEPNESS * np.log(gain / _SECOND_LAMP))
    if gain < _SECOND_LAMP:
        return Count(1, 1.0 - several, more=False)
    third = (fit(2).cost - fit(3).cost) / _THIRD_GAIN
    third += _share_off(evidence.differences, fit(2).matrices) / _THIRD_OFF
    three = _logistic(_THIRD_STEEPNESS * (third - _THIRD_LAMP))
    if third < _THIRD_LAMP:
        return Count(2, min(several, 1.0 - three), more=False)
    if signs_of_fourth(reduced, evidence, fit(3).matrices):
        return Count(3, min(three, _UNSURE), more=True)
    return Count(3, min(several, three), more=False)


def signs_of_fourth(reduced: ReducedPair, evidence: Evidence, matrices: Array) -> bool:
    """Whether three lamps (3, 3, 3) leave more unexplained than three real ones do."""
    signs = left_over(reduced, matrices) / _FOURTH_LEFT
    signs += _share_off(evidence.differences, matrices) / _FOURTH_OFF
    signs += _share_outside(evidence.pixels, matrices) / _FOURTH_OUTSIDE
    return bool(signs > _FOURTH_LAMP)


def left_over(reduced: ReducedPair, matrices: Array) -> float:
    """Relative light that lamps (N, 3, 3) leave unexplained: a quantile, less the noise's own."""
    no_flash, flash = reduced.no_flash[reduced.usable], reduced.flash[reduced.usable]
    weights = (1.0 / no_flash.mean(axis=0)).astype(np.float32)
    predicted = np.maximum(np.einsum("nkl,pl->npk", matrices.astype(np.float32), flash), 0.0)
    explained = (shares(no_flash * weights, predicted * weights)[..., None] * predicted).sum(axis=0)
    light = no_flash.sum(axis=1)
    left = _weighted_quantile(np.abs(no_flash - explained).sum(axis=1) / light, light)
    variance = reduced.no_flash_variance[reduced.usable].sum(axis=1)
    noise = _weighted_quantile(np.sqrt(variance) / light, light)
    return float(np.sqrt(max(left**2 - noise**2, 0.0)))


def _share_off(differences: Data, matrices: Array) -> float:
    """Share of the differences that show none of the lamps alone."""
    if not len(differences):
        return 0.0
    off = np.linalg.norm(differences.u - _corners(differences, matrices), axis=2).min(axis=0)
    return float((off > _OFF + 2 * _deviation(differences)).mean())


def _share_outside(pixels: Data, matrices: Array) -> float:
    """Share of the pixels outside the triangle of three lamps."""
    corners = _corners(pixels, matrices)
    turn = np.sign(_cross(corners[1] - corners[0], corners[2] - corners[0]))
    inside = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        edge = corners[b] - corners[a]
        length = np.maximum(np.linalg.norm(edge, axis=1), 1e-9)
        inside.append(turn * _cross(edge, pixels.u - corners[a]) / length)
    outside = -np.min(inside, axis=0)
    return float((outside > _OUTSIDE + 2 * _deviation(pixels)).mean())


def _corners(data: Data, matrices: Array) -> Array:
    """Chromaticities (N, n, 2) of the lamps on each datum's surface."""
    light = np.einsum("jkl,nl->jnk", matrices, data.x)
    return np.asarray(light[..., :2] / light.sum(axis=2, keepdims=True))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _deviation(data: Data) -> Array:
    return np.asarray(np.sqrt((data.covariance[:, 0] + data.covariance[:, 2]) / 2))


def _weighted_quantile(values: NDArray[np.floating], weights: NDArray[np.floating]) -> float:
    order = np.argsort(values)
    ladder = np.cumsum(weights[order], dtype=np.float64)
    return float(values[order][np.searchsorted(ladder, _QUANTILE * ladder[-1])])


def _logistic(x: float) -> float:
    return float(1.0 / (1.0 + np.exp(-x)))
