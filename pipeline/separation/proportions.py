"""Each lamp's part of every channel of the no-flash photograph, by the model; compiled."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.arrays import Floats32
from pipeline.compiling import compiled, inlined
from pipeline.images.by_matrix import fused_by_matrix
from pipeline.images.frames import (
    Colour,
    Image,
    Numbers,
    Plane,
    Planes,
    by_planes,
    numbers_of,
    planes_of,
)
from pipeline.lamps.lamps import Lamps
from pipeline.light.shares import shares_of_three, shares_of_two
from pipeline.matrixfit.deviations import FARTHEST, TERMS


def predictions(flash: Image, lamps: Lamps) -> Floats32:
    """What each lamp would give where it shines like the flash: T_j I_flash, (N, h, W, 3), ≥ 0."""
    matrices = lamps.matrices.astype(np.float32)
    return np.stack([np.maximum(flash @ matrix.T, 0.0) for matrix in matrices])


def model_proportions(no_flash: Image, flash: Image, lamps: Lamps) -> Floats32:
    """Parts of the lamps, (N, h, W, 3), 0…1, summing to 1 in each channel.

    no_flash, flash: (h, W, 3) linear camera RGB, flash the flash part alone. A lamp gives T_j
    I_flash and what lamps.deviations add, ≥ 0. Shares are found by non-negative least squares in
    the image, each channel weighed by lamps.channel_weights. Where the model gives a channel no
    light, the parts of the pixel's whole light are taken, and equal ones where there is no light
    at all.
    """
    parts = by_planes(len(lamps), *no_flash.shape)
    if len(lamps) == 1:
        parts[...] = 1.0
        return parts
    matrices, weights = lamps.matrices.astype(np.float32), lamps.channel_weights
    loop = _two if len(lamps) == 2 else _three
    where, terms = lamps.deviations.numbers()
    loop(
        planes_of(no_flash),
        planes_of(flash),
        tuple(numbers_of(matrix) for matrix in matrices),
        where,
        terms,
        numbers_of(weights),
        tuple(planes_of(one) for one in parts),
    )
    return parts


@compiled
def _two(
    no_flash: Planes,
    flash: Planes,
    matrices: tuple[Numbers, ...],
    where: Numbers,
    terms: tuple[Numbers, ...],
    weights: Numbers,
    parts: tuple[Planes, ...],
) -> None:
    """Write parts of two lamps, row by row in short loops: one long loop takes longer."""
    own, rest = parts
    rows, width = flash[0].shape
    scratch = np.empty((8, width), np.float32)
    first, second = (scratch[0], scratch[1], scratch[2]), (scratch[3], scratch[4], scratch[5])
    z0, z1 = scratch[6], scratch[7]
    for y in range(rows):
        seen = no_flash[0][y], no_flash[1][y], no_flash[2][y]
        added = flash[0][y], flash[1][y], flash[2][y]
        _light_row(matrices[0], where, terms[0], added, first)
        _light_row(matrices[1], where, terms[1], added, second)
        _share_row(seen, first, second, weights, z0, z1)
        own_row, rest_row = (own[0][y], own[1][y], own[2][y]), (rest[0][y], rest[1][y], rest[2][y])
        _part_row(first, second, z0, z1, own_row, rest_row)


@compiled
def _light_row(m: Numbers, where: Numbers, terms: Numbers, flash: Planes, lit: Planes) -> None:
    """Write what a lamp of matrix m gives with its deviations."""
    red, green, blue = lit
    for x in range(len(red)):
        f = flash[0][x], flash[1][x], flash[2][x]
        red[x], green[x], blue[x] = light_of(m, terms, f, colour_of(where, f))


@compiled
def _share_row(
    no_flash: Planes, first: Planes, second: Planes, weights: Numbers, z0: Plane, z1: Plane
) -> None:
    """Write shares of two lamps in any scale, as parts do not depend on it."""
    for x in range(len(z0)):
        seen = no_flash[0][x], no_flash[1][x], no_flash[2][x]
        a, b = (first[0][x], first[1][x], first[2][x]), (second[0][x], second[1][x], second[2][x])
        z0[x], z1[x], _ = shares_of_two(times(seen, weights), times(a, weights), times(b, weights))


@compiled
def _part_row(
    first: Planes, second: Planes, z0: Plane, z1: Plane, own: Planes, rest: Planes
) -> None:
    """Write parts of two lamps that have shares z0 and z1."""
    one, half = np.float32(1.0), np.float32(0.5)
    for x in range(len(z0)):
        a, b = (first[0][x], first[1][x], first[2][x]), (second[0][x], second[1][x], second[2][x])
        a, b = scaled(a, z0[x]), scaled(b, z1[x])
        total = a[0] + b[0], a[1] + b[1], a[2] + b[2]
        overall = _part(_sum(a), _sum(total), half)
        p, q = _part(a[0], total[0], overall), _part(a[1], total[1], overall)
        r = _part(a[2], total[2], overall)
        own[0][x], own[1][x], own[2][x] = p, q, r
        rest[0][x], rest[1][x], rest[2][x] = one - p, one - q, one - r


@compiled
def _three(
    no_flash: Planes,
    flash: Planes,
    matrices: tuple[Numbers, ...],
    where: Numbers,
    terms: tuple[Numbers, ...],
    weights: Numbers,
    parts: tuple[Planes, ...],
) -> None:
    third = np.float32(1.0 / 3.0)
    for y in range(flash[0].shape[0]):
        for x in range(flash[0].shape[1]):
            seen, f = pixel(no_flash, y, x), pixel(flash, y, x)
            q = colour_of(where, f)
            a, b = light_of(matrices[0], terms[0], f, q), light_of(matrices[1], terms[1], f, q)
            c = light_of(matrices[2], terms[2], f, q)
            z0, z1, z2 = shares_of_three(
                times(seen, weights), times(a, weights), times(b, weights), times(c, weights)
            )
            a, b, c = scaled(a, z0), scaled(b, z1), scaled(c, z2)
            whole = _sum(a) + _sum(b) + _sum(c)
            total = a[0] + b[0] + c[0], a[1] + b[1] + c[1], a[2] + b[2] + c[2]
            _write(parts[0], y, x, a, total, _part(_sum(a), whole, third))
            _write(parts[1], y, x, b, total, _part(_sum(b), whole, third))
            _write(parts[2], y, x, c, total, _part(_sum(c), whole, third))


@inlined
def pixel(planes: Planes, y: int, x: int) -> Colour:
    """All channels of one pixel."""
    return planes[0][y, x], planes[1][y, x], planes[2][y, x]


@inlined
def _sum(a: Colour) -> Any:
    return a[0] + a[1] + a[2]


@inlined
def _part(light: Any, total: Any, otherwise: Any) -> Any:
    part = light / total
    return part if total > 0 else otherwise


@inlined
def _write(planes: Planes, y: int, x: int, light: Colour, total: Colour, otherwise: Any) -> None:
    """A lamp's part of every channel of one pixel."""
    planes[0][y, x] = _part(light[0], total[0], otherwise)
    planes[1][y, x] = _part(light[1], total[1], otherwise)
    planes[2][y, x] = _part(light[2], total[2], otherwise)


@inlined
def colour_of(where: Numbers, f: Colour) -> Colour:
    """Sum of the flash's channels, 0 without light, and its chromaticity as polynomials take it."""
    total = max(_sum(f), np.float32(0.0))
    inverse = np.float32(1.0) / max(total, np.float32(1e-30))
    return (
        total,
        _within((f[0] * inverse - np.float32(where[0])) * np.float32(where[2])),
        _within((f[1] * inverse - np.float32(where[1])) * np.float32(where[3])),
    )


@inlined
def _within(q: Any) -> Any:
    farthest = np.float32(FARTHEST)
    return min(max(q, -farthest), farthest)


@inlined
def _polynomial(terms: Numbers, k: int, q: Colour) -> Any:
    """p(q) of channel k; see Deviations."""
    a, b, i = q[1], q[2], TERMS * k
    even = _cubic(terms, i, a)
    linear = np.float32(terms[i + 4]) + a * (
        np.float32(terms[i + 5]) + a * np.float32(terms[i + 6])
    )
    square = np.float32(terms[i + 7]) + a * np.float32(terms[i + 8])
    return even + b * (linear + b * (square + b * np.float32(terms[i + 9])))


@inlined
def _cubic(terms: Numbers, i: int, a: Any) -> Any:
    return np.float32(terms[i]) + a * (
        np.float32(terms[i + 1]) + a * (np.float32(terms[i + 2]) + a * np.float32(terms[i + 3]))
    )


@inlined
def light_of(m: Numbers, terms: Numbers, f: Colour, q: Colour) -> Colour:
    """What a lamp of matrix m, row by row, gives where the flash gives f; q: its colour_of."""
    r, g, b = fused_by_matrix(m, f[0], f[1], f[2])
    return _deviating(r, terms, 0, q), _deviating(g, terms, 1, q), _deviating(b, terms, 2, q)


@inlined
def _deviating(light: Any, terms: Numbers, k: int, q: Colour) -> Any:
    return max(light + q[0] * _polynomial(terms, k, q), np.float32(0.0))


@inlined
def times(a: Colour, b: Numbers) -> Colour:
    """Light with each channel weighed."""
    return a[0] * np.float32(b[0]), a[1] * np.float32(b[1]), a[2] * np.float32(b[2])


@inlined
def scaled(a: Colour, z: float) -> Colour:
    """Light so many times as bright."""
    return a[0] * np.float32(z), a[1] * np.float32(z), a[2] * np.float32(z)
