"""Each lamp's part of every channel of the no-flash photograph, by the model; compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.frames import Image
from pipeline.lamps import Lamps
from pipeline.shares import Colour, shares_of_three, shares_of_two

Array = NDArray[np.float32]


def predictions(flash: Image, lamps: Lamps) -> Array:
    """What each lamp would give where it shines like the flash: T_j I_flash, (N, h, W, 3), ≥ 0."""
    matrices = lamps.matrices.astype(np.float32)
    return np.stack([np.maximum(flash @ matrix.T, 0.0) for matrix in matrices])


def model_proportions(no_flash: Image, flash: Image, lamps: Lamps) -> Array:
    """Parts of the lamps, (N, h, W, 3), 0…1, summing to 1 in each channel.

    no_flash, flash: (h, W, 3) linear camera RGB, flash the flash part alone. Shares are found by
    non-negative least squares in the image, each channel weighed by lamps.channel_weights. Where
    the model gives a channel no light, the parts of the pixel's whole light are taken, and equal
    ones where there is no light at all.
    """
    parts = np.ones((len(lamps), *no_flash.shape), dtype=np.float32)
    if len(lamps) > 1:
        matrices, weights = lamps.matrices.astype(np.float32), lamps.channel_weights
        loop = _two if len(lamps) == 2 else _three
        loop(
            np.asarray(no_flash, dtype=np.float32),
            np.asarray(flash, dtype=np.float32),
            tuple(tuple(float(one) for one in matrix.ravel()) for matrix in matrices),
            (float(weights[0]), float(weights[1]), float(weights[2])),
            parts,
        )
    return parts


@njit(cache=True, error_model="numpy")
def _two(
    no_flash: Array,
    flash: Array,
    matrices: tuple[tuple[float, ...], ...],
    weights: Colour,
    parts: Array,
) -> None:
    one, half = np.float32(1.0), np.float32(0.5)
    for y in range(no_flash.shape[0]):
        for x in range(no_flash.shape[1]):
            f = flash[y, x, 0], flash[y, x, 1], flash[y, x, 2]
            seen = no_flash[y, x, 0], no_flash[y, x, 1], no_flash[y, x, 2]
            a, b = _lit(matrices[0], f), _lit(matrices[1], f)
            z0, z1 = shares_of_two(_times(seen, weights), _times(a, weights), _times(b, weights))
            a, b = _scaled(a, z0), _scaled(b, z1)
            for k in range(3):
                total = a[k] + b[k]
                if total > 0:
                    part = a[k] / total
                else:
                    whole_a, whole_b = a[0] + a[1] + a[2], b[0] + b[1] + b[2]
                    part = whole_a / (whole_a + whole_b) if whole_a + whole_b > 0 else half
                parts[0, y, x, k], parts[1, y, x, k] = part, one - part


@njit(cache=True, error_model="numpy")
def _three(
    no_flash: Array,
    flash: Array,
    matrices: tuple[tuple[float, ...], ...],
    weights: Colour,
    parts: Array,
) -> None:
    for y in range(no_flash.shape[0]):
        for x in range(no_flash.shape[1]):
            f = flash[y, x, 0], flash[y, x, 1], flash[y, x, 2]
            seen = no_flash[y, x, 0], no_flash[y, x, 1], no_flash[y, x, 2]
            a, b, c = _lit(matrices[0], f), _lit(matrices[1], f), _lit(matrices[2], f)
            z0, z1, z2 = shares_of_three(
                _times(seen, weights), _times(a, weights), _times(b, weights), _times(c, weights)
            )
            a, b, c = _scaled(a, z0), _scaled(b, z1), _scaled(c, z2)
            whole_a, whole_b, whole_c = a[0] + a[1] + a[2], b[0] + b[1] + b[2], c[0] + c[1] + c[2]
            whole = whole_a + whole_b + whole_c
            for k in range(3):
                total = a[k] + b[k] + c[k]
                if total > 0:
                    parts[0, y, x, k], parts[1, y, x, k] = a[k] / total, b[k] / total
                    parts[2, y, x, k] = c[k] / total
                elif whole > 0:
                    parts[0, y, x, k], parts[1, y, x, k] = whole_a / whole, whole_b / whole
                    parts[2, y, x, k] = whole_c / whole
                else:
                    parts[0, y, x, k] = parts[1, y, x, k] = parts[2, y, x, k] = 1.0 / 3.0


@njit(cache=True, error_model="numpy")
def _lit(m: tuple[float, ...], f: Colour) -> Colour:
    """What a lamp of matrix m, row by row, gives where the flash gives f."""
    zero = np.float32(0.0)
    return (
        max(np.float32(m[0]) * f[0] + np.float32(m[1]) * f[1] + np.float32(m[2]) * f[2], zero),
        max(np.float32(m[3]) * f[0] + np.float32(m[4]) * f[1] + np.float32(m[5]) * f[2], zero),
        max(np.float32(m[6]) * f[0] + np.float32(m[7]) * f[1] + np.float32(m[8]) * f[2], zero),
    )


@njit(cache=True, error_model="numpy")
def _times(a: Colour, b: Colour) -> Colour:
    return a[0] * np.float32(b[0]), a[1] * np.float32(b[1]), a[2] * np.float32(b[2])


@njit(cache=True, error_model="numpy")
def _scaled(a: Colour, z: float) -> Colour:
    return a[0] * np.float32(z), a[1] * np.float32(z), a[2] * np.float32(z)
