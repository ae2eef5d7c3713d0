"""Each lamp's part of every channel of the no-flash photograph, by the model; compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.frames import Image, Numbers, Planes, by_planes, numbers_of, planes_of
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
    parts = by_planes(len(lamps), *no_flash.shape)
    if len(lamps) == 1:
        parts[...] = 1.0
        return parts
    matrices, weights = lamps.matrices.astype(np.float32), lamps.channel_weights
    loop = _two if len(lamps) == 2 else _three
    loop(
        planes_of(no_flash),
        planes_of(flash),
        tuple(numbers_of(matrix) for matrix in matrices),
        numbers_of(weights),
        tuple(planes_of(one) for one in parts),
    )
    return parts


@njit(cache=True, error_model="numpy")
def _two(
    no_flash: Planes,
    flash: Planes,
    matrices: tuple[Numbers, ...],
    weights: Numbers,
    parts: tuple[Planes, ...],
) -> None:
    one, half = np.float32(1.0), np.float32(0.5)
    own, rest = parts
    for y in range(flash[0].shape[0]):
        for x in range(flash[0].shape[1]):
            seen, f = _pixel(no_flash, y, x), _pixel(flash, y, x)
            a, b = _lit(matrices[0], f), _lit(matrices[1], f)
            z0, z1 = shares_of_two(_times(seen, weights), _times(a, weights), _times(b, weights))
            a, b = _scaled(a, z0), _scaled(b, z1)
            overall = _part(_sum(a), _sum(a) + _sum(b), half)
            p = _part(a[0], a[0] + b[0], overall)
            q = _part(a[1], a[1] + b[1], overall)
            r = _part(a[2], a[2] + b[2], overall)
            own[0][y, x], own[1][y, x], own[2][y, x] = p, q, r
            rest[0][y, x], rest[1][y, x], rest[2][y, x] = one - p, one - q, one - r


@njit(cache=True, error_model="numpy")
def _three(
    no_flash: Planes,
    flash: Planes,
    matrices: tuple[Numbers, ...],
    weights: Numbers,
    parts: tuple[Planes, ...],
) -> None:
    third = np.float32(1.0 / 3.0)
    for y in range(flash[0].shape[0]):
        for x in range(flash[0].shape[1]):
            seen, f = _pixel(no_flash, y, x), _pixel(flash, y, x)
            a, b, c = _lit(matrices[0], f), _lit(matrices[1], f), _lit(matrices[2], f)
            z0, z1, z2 = shares_of_three(
                _times(seen, weights), _times(a, weights), _times(b, weights), _times(c, weights)
            )
            a, b, c = _scaled(a, z0), _scaled(b, z1), _scaled(c, z2)
            whole = _sum(a) + _sum(b) + _sum(c)
            total = a[0] + b[0] + c[0], a[1] + b[1] + c[1], a[2] + b[2] + c[2]
            _write(parts[0], y, x, a, total, _part(_sum(a), whole, third))
            _write(parts[1], y, x, b, total, _part(_sum(b), whole, third))
            _write(parts[2], y, x, c, total, _part(_sum(c), whole, third))


@njit(cache=True, error_model="numpy", inline="always")
def _pixel(planes: Planes, y: int, x: int) -> Colour:
    return planes[0][y, x], planes[1][y, x], planes[2][y, x]


@njit(cache=True, error_model="numpy", inline="always")
def _sum(a: Colour) -> Any:
    return a[0] + a[1] + a[2]


@njit(cache=True, error_model="numpy", inline="always")
def _part(light: Any, total: Any, otherwise: Any) -> Any:
    part = light / total
    return part if total > 0 else otherwise


@njit(cache=True, error_model="numpy", inline="always")
def _write(planes: Planes, y: int, x: int, light: Colour, total: Colour, otherwise: Any) -> None:
    """A lamp's part of every channel of one pixel."""
    planes[0][y, x] = _part(light[0], total[0], otherwise)
    planes[1][y, x] = _part(light[1], total[1], otherwise)
    planes[2][y, x] = _part(light[2], total[2], otherwise)


@njit(cache=True, error_model="numpy")
def _lit(m: Numbers, f: Colour) -> Colour:
    """What a lamp of matrix m, row by row, gives where the flash gives f."""
    zero = np.float32(0.0)
    return (
        max(np.float32(m[0]) * f[0] + np.float32(m[1]) * f[1] + np.float32(m[2]) * f[2], zero),
        max(np.float32(m[3]) * f[0] + np.float32(m[4]) * f[1] + np.float32(m[5]) * f[2], zero),
        max(np.float32(m[6]) * f[0] + np.float32(m[7]) * f[1] + np.float32(m[8]) * f[2], zero),
    )


@njit(cache=True, error_model="numpy")
def _times(a: Colour, b: Numbers) -> Colour:
    return a[0] * np.float32(b[0]), a[1] * np.float32(b[1]), a[2] * np.float32(b[2])


@njit(cache=True, error_model="numpy")
def _scaled(a: Colour, z: float) -> Colour:
    return a[0] * np.float32(z), a[1] * np.float32(z), a[2] * np.float32(z)
