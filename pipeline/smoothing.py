"""Smooths proportions where the light is smooth, and keeps the edges of shadows; compiled."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.compiling import exact
from pipeline.frames import Image, Plane, Planes, by_planes, channels_first, planes_of

Array = NDArray[np.float32]

_RADIUS = 4  # pixels, of the guided filter's windows
_TOLERANCE = 0.25  # a change of four standard deviations is made by half
_EPSILON = 1e-4  # (0.01)², steps of the guide smaller than this are noise
_KERNEL = np.full(2 * _RADIUS + 1, 1 / (2 * _RADIUS + 1), dtype=np.float32)
HALO = 2 * _RADIUS
"""Rows that smooth_proportions needs beyond either end of a strip."""


def smooth_proportions(
    proportions: Array,
    no_flash: Image,
    flash: Image,
    trust: Array,
    uncertainty: Array,
    keep: slice,
) -> Array:
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
    guide, weight, guided, squared = np.empty((4, *trust.shape), dtype=np.float32)
    _write_guide(planes_of(no_flash), planes_of(flash), trust, guide, weight, guided, squared)
    total, mean, variance = _box(weight), _box(guided), _box(squared)
    _to_variance(total, mean, variance)
    smooth = by_planes(*proportions[:, keep].shape)
    weighed, guided = np.empty_like(guide), np.empty_like(guide)
    for lamp in range(len(proportions) - 1):  # the last lamp has what is left
        for plane, fitted in zip(
            planes_of(proportions[lamp]), planes_of(smooth[lamp]), strict=True
        ):
            _weigh(plane, weight, guide, weighed, guided)
            offset, slope = _box(weighed), _box(guided)
            _to_line(offset, slope, total, mean, variance, weight)
            slope, offset = _box(slope), _box(offset)
            _fit(slope[keep], offset[keep], guide[keep], total[keep], fitted)
    first, _, _ = keep.indices(len(trust))
    _blend(channels_first(proportions), first, uncertainty[keep], channels_first(smooth))
    return smooth


def _box(plane: Plane) -> Plane:
    # not cv2.blur, whose running sums round differently in every strip
    mean = cv2.sepFilter2D(plane, -1, _KERNEL, _KERNEL, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(mean, dtype=np.float32)


@exact
def _write_guide(
    no_flash: Planes,
    flash: Planes,
    trust: Plane,
    guide: Plane,
    weight: Plane,
    guided: Plane,
    squared: Plane,
) -> None:
    """Write the guide, the weight, and the weight times the guide and its square."""
    zero, least = np.float32(0.0), np.float32(1e-9)
    for y in range(trust.shape[0]):
        for x in range(trust.shape[1]):
            light = max(no_flash[0][y, x] + no_flash[1][y, x] + no_flash[2][y, x], zero)
            flashed = max(flash[0][y, x] + flash[1][y, x] + flash[2][y, x], zero)
            edge, sure = light / max(light + flashed, least), trust[y, x] + np.float32(1e-6)
            guide[y, x], weight[y, x] = edge, sure
            guided[y, x], squared[y, x] = sure * edge, sure * edge * edge


@exact
def _to_variance(total: Plane, mean: Plane, variance: Plane) -> None:
    """Turn means of weight, of weighted guide and of its square into mean and variance."""
    for y in range(total.shape[0]):
        for x in range(total.shape[1]):
            middle = mean[y, x] / total[y, x]
            spread = variance[y, x] / total[y, x] - middle * middle
            mean[y, x], variance[y, x] = middle, max(spread, np.float32(0.0))


@exact
def _weigh(part: Plane, weight: Plane, guide: Plane, weighed: Plane, guided: Plane) -> None:
    """Write a lamp's proportion of a channel, weighed, and times the guide."""
    for y in range(weight.shape[0]):
        for x in range(weight.shape[1]):
            one = weight[y, x] * part[y, x]
            weighed[y, x], guided[y, x] = one, one * guide[y, x]


@exact
def _to_line(
    offset: Plane, slope: Plane, total: Plane, mean: Plane, variance: Plane, weight: Plane
) -> None:
    """Turn means of weighed proportion and of its product with the guide into lines, weighed."""
    for y in range(total.shape[0]):
        for x in range(total.shape[1]):
            p_mean = offset[y, x] / total[y, x]
            steep = (slope[y, x] / total[y, x] - mean[y, x] * p_mean) / (
                variance[y, x] + np.float32(_EPSILON)
            )
            slope[y, x] = weight[y, x] * steep
            offset[y, x] = weight[y, x] * (p_mean - steep * mean[y, x])


@exact
def _fit(slope: Plane, offset: Plane, guide: Plane, total: Plane, fitted: Plane) -> None:
    for y in range(total.shape[0]):
        for x in range(total.shape[1]):
            fitted[y, x] = (slope[y, x] * guide[y, x] + offset[y, x]) / total[y, x]


@exact
def _blend(proportions: Array, first: int, uncertainty: Plane, smooth: Array) -> None:
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
