"""The compiled passes of refine.py: which pixels tell of motion, and what equations they give.

Pictures are (h, 3·w) here, the channels of a pixel side by side, so that loops run along rows.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.compiling import exact, summing


@exact
def span(
    matrix: Floats64, y: int, size: tuple[int, int], margin: int, inset: int
) -> tuple[int, int]:
    """First and end of the pixels of row y, margin from the border, that lie in the other picture.

    matrix: (3, 3), to the other picture's pixels. size: (width, height) of both. inset: pixels
    from the other picture's border at least.
    """
    first, end = margin, size[0] - margin
    depth, depth_offset = matrix[2, 0], matrix[2, 1] * y + matrix[2, 2]
    for axis in range(2):
        slope, offset = matrix[axis, 0], matrix[axis, 1] * y + matrix[axis, 2]
        for sign, limit in ((1.0, inset), (-1.0, size[axis] - 1 - inset)):
            # sign · (u − limit) ≥ 0, times the depth, is a line over x
            rise = sign * (slope - limit * depth)
            start = sign * (offset - limit * depth_offset)
            if rise == 0.0:
                if start < 0.0:
                    return 0, 0
                continue
            crossing = min(max(-start / rise, -1.0), size[0] + 1.0)
            if rise > 0.0:
                first = max(first, int(np.ceil(crossing)))
            else:
                end = min(end, int(np.floor(crossing)) + 1)
    return first, max(first, end)


@summing
def _slopes(first: Floats32, second: Floats32, y: int, out: Floats32) -> None:
    """Sobel's gradient of the pictures' mean in row y and its square, (3, 3·w), overwritten."""
    count = first.shape[1]
    along, down = np.empty(count, np.float32), np.empty(count, np.float32)
    two, scale = np.float32(2.0), np.float32(0.0625)  # Sobel's 1/8, halved for the mean
    for i in range(count):
        above = first[y - 1, i] + second[y - 1, i]
        below = first[y + 1, i] + second[y + 1, i]
        along[i] = above + two * (first[y, i] + second[y, i]) + below
        down[i] = below - above
    for i in range(3, count - 3):
        gx = scale * (along[i + 3] - along[i - 3])
        gy = scale * (down[i - 3] + two * down[i] + down[i + 3])
        out[0, i], out[1, i], out[2, i] = gx, gy, gx * gx + gy * gy


@exact
def sampled(
    first: Floats32, second: Floats32, matrix: Floats64, margin: int, inset: int, step: int
) -> tuple[Floats32, Floats32]:
    """Squared gradients of the mean, and differences, (3, n), of each step-th row's pixels.

    first, second: (h, 3·w), the second laid on the first by matrix. Pixels: see span; margin ≥ 1.
    """
    height, width = first.shape[0], first.shape[1] // 3
    strengths = np.empty((3, (height // step + 1) * width), np.float32)
    differences = np.empty_like(strengths)
    slopes = np.zeros((3, 3 * width), np.float32)
    count = 0
    for y in range(margin, height - margin, step):
        start, end = span(matrix, y, (width, height), margin, inset)
        if start == end:
            continue
        _slopes(first, second, y, slopes)
        for x in range(start, end):
            for k in range(3):
                i = 3 * x + k
                strengths[k, count] = slopes[2, i]
                differences[k, count] = first[y, i] - second[y, i]
            count += 1
    return strengths[:, :count], differences[:, :count]


@summing
def equations(
    first: Floats32,
    second: Floats32,
    matrix: Floats64,
    margin: int,
    inset: int,
    least: Floats32,
    widest: Floats32,
    to_unit: Floats64,
) -> Floats64:
    """Normal equations (8, 9) of a motion by the pixels that tell, right hand side last.

    least: (3,), squared gradient of each channel above which a pixel tells. widest: (3,),
    difference at which it counts for nothing (Tukey's biweight). to_unit: (3, 3), to the
    coordinates of the motion. The rest as in sampled.
    """
    height, width = first.shape[0], first.shape[1] // 3
    unit, left, top = to_unit[0, 0], to_unit[0, 2], to_unit[1, 2]
    sums = np.zeros((8, 9))
    slopes = np.zeros((3, 3 * width), np.float32)
    rows, weighted = np.empty((9, width), np.float32), np.empty((8, width), np.float32)
    places = np.empty(width, np.int64)
    for y in range(margin, height - margin):
        start, end = span(matrix, y, (width, height), margin, inset)
        if start == end:
            continue
        _slopes(first, second, y, slopes)
        v = np.float32(y * unit + top)
        for k in range(3):
            count = 0
            for x in range(start, end):
                places[count] = x
                count += slopes[2, 3 * x + k] > least[k]
            for n in range(count):
                x = places[n]
                i = 3 * x + k
                difference = first[y, i] - second[y, i]
                off = difference / widest[k]
                weight = max(np.float32(1.0) - off * off, np.float32(0.0)) / widest[k]
                gx, gy = slopes[0, i] / np.float32(unit), slopes[1, i] / np.float32(unit)
                u = np.float32(x * unit + left)
                along = gx * u + gy * v
                rows[0, n], rows[1, n], rows[2, n] = gx * u, gx * v, gx
                rows[3, n], rows[4, n], rows[5, n] = gy * u, gy * v, gy
                rows[6, n], rows[7, n], rows[8, n] = -along * u, -along * v, difference
                for j in range(8):
                    weighted[j, n] = weight * weight * rows[j, n]
            for j in range(8):
                for m in range(j, 9):
                    total = np.float32(0.0)
                    for n in range(count):
                        total += weighted[j, n] * rows[m, n]
                    sums[j, m] += total
    for j in range(8):
        for m in range(j):
            sums[j, m] = sums[m, j]
    return sums


@summing
def add_products(
    first: Floats32,
    second: Floats32,
    matrix: Floats64,
    top: int,
    height: int,
    inset: int,
    sums: Floats64,
) -> None:
    """Add sums of squares of both, and of their products, of the pixels in both (see span).

    first, second: rows from top on of pictures of that height. sums: (n, 3), of n columns of blocks
    from left to right.
    """
    width, count = first.shape[1] // 3, len(sums)
    for y in range(len(first)):
        start, end = span(matrix, top + y, (width, height), 0, inset)
        for block in range(count):
            left = max(start, block * width // count)
            right = min(end, (block + 1) * width // count)
            squares, other_squares, shared = 0.0, 0.0, 0.0
            for i in range(3 * left, 3 * right):
                squares += first[y, i] * first[y, i]
                other_squares += second[y, i] * second[y, i]
                shared += first[y, i] * second[y, i]
            sums[block, 0] += squares
            sums[block, 1] += other_squares
            sums[block, 2] += shared
