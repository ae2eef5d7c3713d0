"""Second differences of a photograph along both axes, by blocks; compiled.

Of both axes at once, [1, −2, 1] ⊗ [1, −2, 1] ÷ 6: the variance of white noise stays as it is, and
slopes and straight edges along an axis vanish. At the left and right border the picture is
mirrored about its last pixel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.compiling import exact
from pipeline.frames import Image, Mask

Array = NDArray[np.float32]

BLOCK = 8
_INNER = (BLOCK - 2) * BLOCK
"""Second differences of a block: its first and last row have none."""

_KEPT = 0.8
"""Share of white noise that is left by a regression on three others."""


@exact
def _row(pixels: Image, y: int, along: Array, out: Array) -> None:
    """Second differences (W, 3) around row y, overwritten; along: scratch."""
    two, sixth = np.float32(2.0), np.float32(1.0 / 6.0)
    width = pixels.shape[1]
    for x in range(width):
        for k in range(3):
            along[x + 1, k] = (pixels[y - 1, x, k] - pixels[y, x, k]) + (
                pixels[y + 1, x, k] - pixels[y, x, k]
            )
    for k in range(3):
        along[0, k] = along[2, k]
        along[width + 1, k] = along[width - 1, k]
    for x in range(width):
        for k in range(3):
            out[x, k] = sixth * (along[x, k] - two * along[x + 1, k] + along[x + 2, k])


@exact
def block_squares(pixels: Image) -> tuple[Array, Array]:
    """Mean (3, n) and squared second differences (3, n, 48) of all blocks, row by row."""
    height, width = pixels.shape[:2]
    rows, columns = height // BLOCK, width // BLOCK
    means = np.zeros((3, rows * columns), np.float32)
    squares = np.empty((3, rows * columns, _INNER), np.float32)
    along, line = np.empty((width + 2, 3), np.float32), np.empty((width, 3), np.float32)
    for row in range(rows):
        top = row * BLOCK
        for y in range(BLOCK):
            for b in range(columns):
                for x in range(b * BLOCK, (b + 1) * BLOCK):
                    for k in range(3):
                        means[k, row * columns + b] += pixels[top + y, x, k]
            if y == 0 or y == BLOCK - 1:
                continue
            _row(pixels, top + y, along, line)
            for k in range(3):
                for b in range(columns):
                    for x in range(BLOCK):
                        at = (y - 1) * BLOCK + x
                        squares[k, row * columns + b, at] = line[b * BLOCK + x, k] ** 2
    means /= np.float32(BLOCK * BLOCK)
    return means, squares


@exact
def unshared_squares(pixels: Image, other: Image) -> Array:
    """Squares as of block_squares, of what another picture of the same things does not explain.

    other: (H, W, 3). In each block, each channel's second differences are regressed on those of
    the other's channels: of a texture in even light, nothing is left. White noise keeps _KEPT of
    its variance, by which what is left is divided.
    """
    height, width = pixels.shape[:2]
    rows, columns = height // BLOCK, width // BLOCK
    squares = np.empty((3, rows * columns, _INNER), np.float32)
    along = np.empty((width + 2, 3), np.float32)
    lines, others = np.empty((2, BLOCK - 2, width, 3), np.float32)
    for row in range(rows):
        top = row * BLOCK
        for y in range(BLOCK - 2):
            _row(pixels, top + y + 1, along, lines[y])
            _row(other, top + y + 1, along, others[y])
        for b in range(columns):
            inside = slice(b * BLOCK, (b + 1) * BLOCK)
            _regress(lines[:, inside], others[:, inside], squares[:, row * columns + b])
    return squares


@exact
def _regress(line: Array, other: Array, squares: Array) -> None:
    """Squares (3, 48) of what the regression of (6, 8, 3) on (6, 8, 3) leaves, overwritten."""
    gram, cross = np.zeros((3, 3), np.float32), np.zeros((3, 3), np.float32)
    for y in range(BLOCK - 2):
        for x in range(BLOCK):
            for j in range(3):
                for k in range(3):
                    gram[j, k] += other[y, x, j] * other[y, x, k]
                    cross[j, k] += other[y, x, j] * line[y, x, k]
    least = np.float32(1e-5) * (gram[0, 0] + gram[1, 1] + gram[2, 2]) + np.float32(1e-30)
    for j in range(3):
        gram[j, j] += least
    slopes = np.linalg.solve(gram, cross)
    for y in range(BLOCK - 2):
        for x in range(BLOCK):
            for k in range(3):
                left = line[y, x, k]
                for j in range(3):
                    left -= slopes[j, k] * other[y, x, j]
                squares[k, y * BLOCK + x] = left * left / np.float32(_KEPT)


@exact
def block_variances(pixels: Image) -> tuple[Array, Array]:
    """Means (H // 8, W // 8, 3) of all blocks, and of their squared second differences."""
    height, width = pixels.shape[:2]
    rows, columns = height // BLOCK, width // BLOCK
    means = np.zeros((rows, columns, 3), np.float32)
    variances = np.zeros((rows, columns, 3), np.float32)
    along, line = np.empty((width + 2, 3), np.float32), np.empty((width, 3), np.float32)
    for row in range(rows):
        for y in range(BLOCK):
            inner = y != 0 and y != BLOCK - 1
            if inner:
                _row(pixels, row * BLOCK + y, along, line)
            for b in range(columns):
                for x in range(b * BLOCK, (b + 1) * BLOCK):
                    for k in range(3):
                        means[row, b, k] += pixels[row * BLOCK + y, x, k]
                        if inner:
                            variances[row, b, k] += line[x, k] ** 2
    means /= np.float32(BLOCK * BLOCK)
    variances /= np.float32(_INNER)
    return means, variances


@exact
def relative_squares(
    pixels: Image, inside: Mask, gain: NDArray[np.float64], floor: NDArray[np.float64]
) -> Array:
    """Squared second differences over the noise's variance gain·I + floor, of pixels inside (3, n).

    inside: (H, W), nowhere on the first or last row.
    """
    height, width = inside.shape
    out = np.empty((3, np.count_nonzero(inside)), np.float32)
    along, line = np.empty((width + 2, 3), np.float32), np.empty((width, 3), np.float32)
    count = 0
    for y in range(1, height - 1):
        if not inside[y].any():
            continue
        _row(pixels, y, along, line)
        for x in range(width):
            if inside[y, x]:
                for k in range(3):
                    variance = gain[k] * max(pixels[y, x, k], 0.0) + floor[k]
                    out[k, count] = line[x, k] ** 2 / variance
                count += 1
    return out


@exact
def squares_within(squares: Array, limit: Array) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """How many of each row (n, m) are below its limit (n,), and their sums."""
    counts, totals = np.zeros(len(squares), np.int64), np.zeros(len(squares))
    for i in range(len(squares)):
        count, total, most = np.int32(0), np.float32(0.0), limit[i]
        for j in range(squares.shape[1]):
            below = squares[i, j] < most
            count += below
            total += squares[i, j] if below else np.float32(0.0)
        counts[i], totals[i] = count, total
    return counts, totals
