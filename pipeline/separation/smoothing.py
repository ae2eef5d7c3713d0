"""Smooths proportions where the light is smooth, and keeps the edges of shadows; compiled."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32
from pipeline.compiling import compiled, exact
from pipeline.images.frames import Image, Plane, Planes, by_planes, channels_first, planes_of
from pipeline.images.strips import widened

_RADIUS = 4  # pixels, of the guided filter's windows
_TOLERANCE = 0.25  # a change of four standard deviations is made by half
_EPSILON = 1e-4  # (0.01)², steps of the guide smaller than this are noise
_COLUMNS = 512  # worked on at a time: with all rows they stay in the processor's cache
HALO = 2 * _RADIUS
"""Rows that smooth_proportions needs beyond either end of a strip."""


def smooth_proportions(
    proportions: Floats32,
    no_flash: Image,
    flash: Image,
    trust: Floats32,
    uncertainty: Floats32,
    keep: slice,
) -> Floats32:
    """Guided filter (He, Sun and Tang 2010) with the light itself as the guide.

    The guide is the brightness of the lamps against that of the flash, s_n/(s_n + s_f): surfaces
    cancel in it, shadows do not. So proportions are averaged across patterns on a surface and
    not across the edge of a shadow. What the filter changes by more than noise can have done is
    left as it was.

    Parameters
    ----------
    proportions : (N, h, W, 3), 0…1
    no_flash, flash : (h, W, 3), the no-flash photograph and the flash part, noise filtered
    trust : (h, W) 0…1, weight of each pixel
    uncertainty : (h, W) 0…1, standard deviation that noise may give a proportion
    keep : the rows to return; the others, HALO on either side or up to the border, are halo

    Returns
    -------
    (N, len(keep), W, 3) float32, 0…1
    """
    if len(proportions) == 1:
        return proportions[:, keep]
    parts = channels_first(proportions)
    first = keep.indices(len(trust))[0]
    smooth = by_planes(*proportions[:, keep].shape)
    found = channels_first(smooth)
    guide, weight = np.empty((2, *trust.shape), np.float32)
    _write_guide(planes_of(no_flash), planes_of(flash), trust, guide, weight)
    width = trust.shape[1]
    for left in range(0, width, _COLUMNS):
        columns = slice(left, min(left + _COLUMNS, width))
        wide, inner = widened(columns, HALO, width)
        shared = np.ascontiguousarray(guide[:, wide]), np.ascontiguousarray(weight[:, wide])
        _fit(parts, *shared, wide.start, inner.start, columns.stop - left, first, found)
    _blend(parts, first, uncertainty[keep], found)
    return smooth


@exact
def _write_guide(
    no_flash: Planes, flash: Planes, trust: Plane, guide: Plane, weight: Plane
) -> None:
    """Write the guide and the weight."""
    zero, least = np.float32(0.0), np.float32(1e-9)
    for y in range(trust.shape[0]):
        for x in range(trust.shape[1]):
            light = max(no_flash[0][y, x] + no_flash[1][y, x] + no_flash[2][y, x], zero)
            flashed = max(flash[0][y, x] + flash[1][y, x] + flash[2][y, x], zero)
            guide[y, x] = light / max(light + flashed, least)
            weight[y, x] = trust[y, x] + np.float32(1e-6)


@compiled
def _weigh_guide(guide: Plane, weight: Plane, top: int, lines: Floats32) -> None:
    """Write what the lines of all proportions share, for rows of the guide from top on.

    lines: (3, n, W): 1 ÷ the windows' weight, the mean of the guide, 1 ÷ (its variance + ε).
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    height, width = guide.shape
    guided, squared = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            guided[y, x] = weight[y, x] * guide[y, x]
            squared[y, x] = guided[y, x] * guide[y, x]
    sums, scratch = np.empty((3, width), np.float32), np.empty((2, width + 2 * _RADIUS), np.float32)
    total, mean, square = sums[0], sums[1], sums[2]
    for row in range(lines.shape[1]):
        _window(weight, top + row, scratch, total)
        _window(guided, top + row, scratch, mean)
        _window(squared, top + row, scratch, square)
        inverse, middle, steepness = lines[0, row], lines[1, row], lines[2, row]
        for x in range(width):
            share = one / total[x]
            of_guide = mean[x] * share
            spread = max(square[x] * share - of_guide * of_guide, zero)
            inverse[x], middle[x] = share, of_guide
            steepness[x] = one / (spread + np.float32(_EPSILON))


@compiled
def _fit(
    parts: Floats32,
    guide: Plane,
    weight: Plane,
    start: int,
    left: int,
    count: int,
    first: int,
    smooth: Floats32,
) -> None:
    """Fit lines to the proportions (N, 3, h, W) around pixels; write what they give there.

    The last lamp is left out. guide, weight: of columns from start on, of which so many from left
    on are written. first: the row of these that is the first of smooth (N, 3, n, W).
    """
    height, width = guide.shape
    top = max(first - _RADIUS, 0)  # rows whose lines those that are asked for look at
    lines = np.empty((3, min(first + smooth.shape[2] + _RADIUS, height) - top, width), np.float32)
    _weigh_guide(guide, weight, top, lines)
    weighed, guided = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    offset, slope = np.empty(lines.shape[1:], np.float32), np.empty(lines.shape[1:], np.float32)
    sums, scratch = np.empty((2, width), np.float32), np.empty((2, width + 2 * _RADIUS), np.float32)
    one, other = sums[0], sums[1]
    right = left + count
    for lamp in range(len(parts) - 1):
        for channel in range(3):
            for y in range(height):
                part = parts[lamp, channel, y, start : start + width]
                _weigh_row(part, weight[y], guide[y], weighed[y], guided[y])
            for row in range(len(offset)):
                _window(weighed, top + row, scratch, one)
                _window(guided, top + row, scratch, other)
                _line_row(one, other, lines, row, weight[top + row], offset[row], slope[row])
            for row in range(smooth.shape[2]):
                y = first + row
                _window(slope, y - top, scratch, one)
                _window(offset, y - top, scratch, other)
                fitted = smooth[lamp, channel, row, start + left : start + right]
                inverse = lines[0, y - top, left:right]
                _fit_row(one[left:right], other[left:right], guide[y, left:right], inverse, fitted)


@compiled
def _weigh_row(
    part: Floats32, weight: Floats32, guide: Floats32, weighed: Floats32, guided: Floats32
) -> None:
    """Write proportions of a row, weighed, and times the guide."""
    for x in range(len(part)):
        product = weight[x] * part[x]
        weighed[x], guided[x] = product, product * guide[x]


@compiled
def _line_row(
    weighed: Floats32,
    guided: Floats32,
    lines: Floats32,
    row: int,
    weight: Floats32,
    offset: Floats32,
    slope: Floats32,
) -> None:
    """Write the lines of a row, weighed, from sums of weighed proportions and those times guide."""
    inverse, mean, steepness = lines[0, row], lines[1, row], lines[2, row]
    for x in range(len(weighed)):
        p_mean = weighed[x] * inverse[x]
        rise = (guided[x] * inverse[x] - mean[x] * p_mean) * steepness[x]
        slope[x], offset[x] = weight[x] * rise, weight[x] * (p_mean - rise * mean[x])


@compiled
def _fit_row(
    slope: Floats32, offset: Floats32, guide: Floats32, inverse: Floats32, fitted: Floats32
) -> None:
    for x in range(len(fitted)):
        fitted[x] = (slope[x] * guide[x] + offset[x]) * inverse[x]


@compiled
def _window(plane: Plane, y: int, scratch: Floats32, sums: Floats32) -> None:
    """Write sums (W,) over the windows around a row's pixels, beyond borders those of the border.

    Not by running sums, which round differently in every strip.
    """
    height, width = plane.shape
    columns, triples = scratch[0], scratch[1]
    inner = columns[_RADIUS : _RADIUS + width]
    r0, r1 = plane[max(y - 4, 0)], plane[max(y - 3, 0)]
    r2, r3, r4 = plane[max(y - 2, 0)], plane[max(y - 1, 0)], plane[y]
    last = height - 1
    r5, r6 = plane[min(y + 1, last)], plane[min(y + 2, last)]
    r7, r8 = plane[min(y + 3, last)], plane[min(y + 4, last)]
    for x in range(width):
        above, below = (r0[x] + r1[x]) + (r2[x] + r3[x]), (r5[x] + r6[x]) + (r7[x] + r8[x])
        inner[x] = above + r4[x] + below
    columns[:_RADIUS], columns[_RADIUS + width :] = inner[0], inner[width - 1]
    for x in range(width + 6):
        triples[x] = columns[x] + columns[x + 1] + columns[x + 2]
    for x in range(width):
        sums[x] = triples[x] + triples[x + 3] + triples[x + 6]


@exact
def _blend(proportions: Floats32, first: int, uncertainty: Plane, smooth: Floats32) -> None:
    """Complete the fitted proportions, and go from the given ones as far as noise allows.

    proportions: (N, 3, H, w), of which row first belongs to row 0 of smooth (N, 3, h, w).
    """
    zero, one, tolerance = np.float32(0.0), np.float32(1.0), np.float32(_TOLERANCE)
    count, _, height, width = smooth.shape
    most, total = np.empty((2, width), np.float32)
    for y in range(height):
        most[:] = zero
        for k in range(3):
            last = smooth[count - 1, k, y]
            last[:] = one
            total[:] = zero
            for j in range(count):
                part = smooth[j, k, y]
                if j < count - 1:
                    for x in range(width):
                        last[x] -= part[x]
                for x in range(width):
                    part[x] = min(max(part[x], zero), one)
                    total[x] += part[x]
            for j in range(count):
                part, given = smooth[j, k, y], proportions[j, k, first + y]
                for x in range(width):
                    change = part[x] / max(total[x], np.float32(1e-6)) - given[x]
                    part[x], most[x] = change, max(most[x], abs(change))
        for x in range(width):
            noise, change = uncertainty[y, x] * uncertainty[y, x], tolerance * most[x]
            most[x] = noise / max(noise + change * change, np.float32(1e-12))
        for j in range(count):
            for k in range(3):
                part, given = smooth[j, k, y], proportions[j, k, first + y]
                for x in range(width):
                    part[x] = given[x] + most[x] * part[x]
