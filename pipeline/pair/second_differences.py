"""Second differences of a photograph along both axes, by blocks; compiled.

Of both axes at once, [1, −2, 1] ⊗ [1, −2, 1] ÷ 6: the variance of white noise stays as it is, and
slopes and straight edges along an axis vanish. At the left and right border the picture is
mirrored about its last pixel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.compiling import exact, summing
from pipeline.images.frames import Image, Mask

BLOCK = 8
_INNER = (BLOCK - 2) * BLOCK
"""Second differences of a block: its first and last row have none."""

_KEPT = 0.8
"""Share of white noise that is left by a regression on three others."""


@exact
def _row(pixels: Image, y: int, along: Floats32, out: Floats32) -> None:
    """Second differences (W, 3) around row y, overwritten; along: scratch, (W + 2, 3)."""
    two, sixth = np.float32(2.0), np.float32(1.0 / 6.0)
    width = pixels.shape[1]
    # all channels side by side, so that loops are long
    above, middle, below = pixels[y - 1].ravel(), pixels[y].ravel(), pixels[y + 1].ravel()
    flat, written = along.reshape(-1), out.reshape(-1)
    inner, first, last = flat[3:], flat[:-6], flat[6:]
    for i in range(3 * width):
        inner[i] = (above[i] - middle[i]) + (below[i] - middle[i])
    for k in range(3):  # by numbers: the assignment of whole rows takes seconds to compile
        along[0, k], along[width + 1, k] = along[2, k], along[width - 1, k]
    for i in range(3 * width):
        written[i] = sixth * (first[i] - two * inner[i] + last[i])


@exact
def block_squares(pixels: Image) -> tuple[Floats32, Floats32]:
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
def unshared_squares(pixels: Image, other: Image) -> Floats32:
    """Squares as of block_squares, of what another picture of the same things does not explain.

    other: (H, W, 3). In each block, each channel's second differences are regressed on those of
    the other's channels: of a texture in even light, nothing is left. White noise keeps _KEPT of
    its variance, by which what is left is divided.
    """
    height, width = pixels.shape[:2]
    rows, columns = height // BLOCK, width // BLOCK
    squares = np.empty((3, rows * columns, _INNER), np.float32)
    along = np.empty((width + 2, 3), np.float32)
    lines = np.empty((BLOCK - 2, width, 3), np.float32)
    others = np.empty_like(lines)
    own, known = np.empty((2, 3, _INNER), np.float32)
    for row in range(rows):
        top = row * BLOCK
        for y in range(BLOCK - 2):
            _row(pixels, top + y + 1, along, lines[y])
            _row(other, top + y + 1, along, others[y])
        for b in range(columns):
            _by_channels(lines, b, own)
            _by_channels(others, b, known)
            _regress(own, known, squares[:, row * columns + b])
    return squares


@exact
def _by_channels(lines: Floats32, block: int, channels: Floats32) -> None:
    """Write a block's part of rows (6, W, 3) as channels (3, 48), along which loops are vectors."""
    for y in range(BLOCK - 2):
        for x in range(BLOCK):
            for k in range(3):
                channels[k, y * BLOCK + x] = lines[y, block * BLOCK + x, k]


@summing
def _regress(own: Floats32, known: Floats32, squares: Floats32) -> None:
    """Squares (3, 48) of what the regression of (3, 48) on (3, 48) leaves, overwritten."""
    a, b, c = known[0], known[1], known[2]
    aa = bb = cc = ab = ac = bc = np.float32(0.0)
    for i in range(_INNER):
        aa, bb, cc = aa + a[i] * a[i], bb + b[i] * b[i], cc + c[i] * c[i]
        ab, ac, bc = ab + a[i] * b[i], ac + a[i] * c[i], bc + b[i] * c[i]
    least = np.float64(1e-5) * (aa + bb + cc) + 1e-30
    # by Cholesky's factors, in double precision as channels are much alike
    f0 = np.sqrt(aa + least)
    f1, f2 = ab / f0, ac / f0
    f3 = np.sqrt(bb + least - f1 * f1)
    f4 = (bc - f1 * f2) / f3
    f5 = np.sqrt(cc + least - f2 * f2 - f4 * f4)
    for k in range(3):
        line = own[k]
        along = along_b = along_c = np.float32(0.0)
        for i in range(_INNER):
            along += line[i] * a[i]
            along_b += line[i] * b[i]
            along_c += line[i] * c[i]
        g0 = along / f0
        g1 = (along_b - f1 * g0) / f3
        of_c = (along_c - f2 * g0 - f4 * g1) / (f5 * f5)
        of_b = (g1 - f4 * of_c) / f3
        of_a = (g0 - f1 * of_b - f2 * of_c) / f0
        p, q, r = np.float32(of_a), np.float32(of_b), np.float32(of_c)
        for i in range(_INNER):
            left = line[i] - p * a[i] - q * b[i] - r * c[i]
            squares[k, i] = left * left * np.float32(1 / _KEPT)


@exact
def block_variances(pixels: Image) -> tuple[Floats32, Floats32]:
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
def relative_squares(pixels: Image, inside: Mask, gain: Floats64, floor: Floats64) -> Floats32:
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


@summing
def squares_within(squares: Floats32, limit: Floats32) -> tuple[NDArray[np.int64], Floats64]:
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
