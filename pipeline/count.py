"""How many lamps a pair needs, by what is left over when one or two lamps explain it.

One lamp is one 3×3 matrix from flash to lamp, whatever the surfaces. So the best single matrix
leaves only noise and metamerism; more is the mark of a second lamp, and likewise of a third.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Matrix
from pipeline.reduced import ReducedPair
from pipeline.shares import shares

Array = NDArray[np.float64]

_PIXELS = 6_000
_DARK = 0.1  # of the 99th percentile: below, rendering curves and stray light bend colours
_DIM_FLASH = 0.02
_QUANTILE = 0.9

# Measured on rendered scenes: one lamp leaves at most .038, two lamps 9° apart at least .046.
_ONE_LAMP = 0.040
_TWO_LAMPS = 0.022  # two leave .010 to .023, three at least 20° apart .024 and more
_RENDERED = 1.6  # tone curves and gamut mapping leave more
_STEEPNESS = 4.0

_ROUNDS_ONE, _ROUNDS_TWO = 12, 8
_RIDGE_ONE, _RIDGE_TWO = 1e-3, 3e-3


@dataclass(frozen=True)
class _Sample:
    """Usable pixels: no_flash, flash (n, 3), variance (n,) of the sum of no-flash channels."""

    no_flash: Array
    flash: Array
    variance: Array


def count_lamps(
    reduced: ReducedPair, one: Matrix, two: Matrix, rendered: bool
) -> tuple[int, float]:
    """Number of lamps, 1 to 3, and the confidence in it, 0…1.

    Parameters
    ----------
    reduced : the pair
    one : (3, 3) first guess of the matrix of a single lamp
    two : (2, 3, 3) first guess of two lamps' matrices
    rendered : the photographs are not sensor values
    """
    sample = _draw(reduced)
    left_by_one = _left_over(sample, sample.flash @ _single(sample, one).T)
    sure = _sureness(left_by_one, _ONE_LAMP)
    if left_by_one <= _ONE_LAMP:
        return 1, sure
    left_by_two = _left_over(sample, _double(sample, two))
    limit = _TWO_LAMPS * (_RENDERED if rendered else 1.0)
    sure *= _sureness(left_by_two, limit)
    return (2 if left_by_two <= limit else 3), sure


def _draw(reduced: ReducedPair) -> _Sample:
    light, flash = reduced.no_flash.sum(axis=2), reduced.flash.sum(axis=2)
    use = (
        reduced.usable
        & (light > _DARK * np.percentile(light, 99))
        & (flash > _DIM_FLASH * np.percentile(flash, 99))
    )
    if not use.any():
        use = reduced.usable
    step = -(-int(use.sum()) // _PIXELS)
    return _Sample(
        reduced.no_flash[use][::step].astype(np.float64),
        reduced.flash[use][::step].astype(np.float64),
        reduced.no_flash_variance.sum(axis=2)[use][::step].astype(np.float64),
    )


def _sureness(value: float, limit: float) -> float:
    """0.5 at the limit, towards 1 as the value leaves it on either side."""
    ratio = max(value, 1e-6) / limit
    return float(1.0 / (1.0 + min(ratio, 1.0 / ratio) ** _STEEPNESS))


def _left_over(sample: _Sample, fitted: Array) -> float:
    """Nine tenths of the pixels lie nearer to the fit, in chromaticity, noise taken off."""
    total = sample.no_flash.sum(1)
    fitted_total = np.maximum(fitted.sum(1), 1e-3 * total)
    distance = sample.no_flash / total[:, None] - fitted / fitted_total[:, None]
    squared = (distance**2).sum(1) - sample.variance / total**2
    return float(np.sqrt(max(np.quantile(squared, _QUANTILE), 0.0)))


def _single(sample: _Sample, start: Matrix) -> Matrix:
    """Fit one matrix to every chromaticity, robustly (Gauss–Newton)."""
    x = sample.flash / sample.flash.sum(1, keepdims=True)
    u = sample.no_flash / sample.no_flash.sum(1, keepdims=True)
    start = start / np.linalg.norm(start)
    matrix = start
    for _ in range(_ROUNDS_ONE):
        raw = x @ matrix.T
        total = np.maximum(raw.sum(1), 1e-3)
        p = raw / total[:, None]
        error = u - p
        weight = _robust(np.linalg.norm(error, axis=1))
        # ∂p_k/∂T_ml = x_l (δ_km − p_k) / Σ_k (T x)_k
        jacobian = (np.eye(3) - p[:, :, None]) / total[:, None, None]
        jacobian = (jacobian[..., None] * x[:, None, None, :]).reshape(-1, 3, 9)
        hessian = np.einsum("pka,pkb,p->ab", jacobian, jacobian, weight, optimize=True)
        gradient = np.einsum("pka,pk,p->a", jacobian, error, weight, optimize=True)
        ridge = _RIDGE_ONE * np.trace(hessian) / 9
        gradient += ridge * (start - matrix).ravel()
        matrix = matrix + np.linalg.solve(hessian + ridge * np.eye(9), gradient).reshape(3, 3)
        matrix = matrix / np.linalg.norm(matrix)
    return np.asarray(matrix)


def _double(sample: _Sample, start: Matrix) -> Array:
    """Light (n, 3) of two lamps fitted by turns: shares of the pixels, matrices of the lamps."""
    x, y = sample.flash, sample.no_flash
    relative = 1.0 / y.sum(1)
    matrices = start
    for _ in range(_ROUNDS_TWO):
        z, fitted = _mixed(sample, matrices)
        weight = relative * np.sqrt(_robust(np.abs(y - fitted).sum(1) * relative))
        design = np.concatenate([z[j][:, None] * x for j in range(2)], axis=1) * weight[:, None]
        normal = design.T @ design
        ridge = _RIDGE_TWO * np.trace(normal) / len(normal)
        known = start.transpose(0, 2, 1).reshape(6, 3)
        target = design.T @ (y * weight[:, None]) + ridge * known
        solved = np.linalg.solve(normal + ridge * np.eye(6), target)
        matrices = solved.reshape(2, 3, 3).transpose(0, 2, 1)
    return _mixed(sample, matrices)[1]


def _mixed(sample: _Sample, matrices: Matrix) -> tuple[NDArray[np.float32], Array]:
    predictions = np.einsum("nkl,pl->npk", matrices, sample.flash)
    z = shares(sample.no_flash.astype(np.float32), predictions.astype(np.float32))
    return z, np.asarray((z[..., None] * predictions).sum(0))


def _robust(distance: Array) -> Array:
    """Cauchy weights at twice the standard deviation of the bulk."""
    scale = 2 * (1.48 * float(np.median(distance)) + 1e-9)
    return np.asarray(1.0 / (1.0 + (distance / scale) ** 2))
