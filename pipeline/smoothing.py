"""Smooths proportions where the light is smooth, and keeps the edges of shadows; compiled."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.frames import Image

Array = NDArray[np.float32]

_RADIUS = 4
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
    _write_guide(no_flash, flash, trust, guide, weight, guided, squared)
    total, mean, variance = _box(weight), _box(guided), _box(squared)
    _to_variance(total, mean, variance)
    smooth = np.empty((len(proportions), *proportions[0, keep].shape), dtype=np.float32)
    p_mean, slope, inside = np.empty_like(guide), np.empty_like(guide), (guide[keep], total[keep])
    for lamp, one in enumerate(proportions[:-1]):  # the last lamp has what is left
        for channel in range(3):
            _weigh(one, channel, weight, guide, p_mean, slope)
            offset, slope = _box(p_mean), _box(slope)
            _to_line(offset, slope, total, mean, variance, weight)
            slope, offset = _box(slope), _box(offset)
            _write_fitted(slope[keep], offset[keep], *inside, smooth[lamp], channel)
    _blend(proportions[:, keep], uncertainty[keep], smooth)
    return smooth


def _box(plane: Array) -> Array:
    # not cv2.blur, whose running sums round differently in every strip
    mean = cv2.sepFilter2D(plane, -1, _KERNEL, _KERNEL, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(mean, dtype=np.float32)


@njit(cache=True, error_model="numpy")
def _write_guide(
    no_flash: Image,
    flash: Image,
    trust: Array,
    guide: Array,
    weight: Array,
    guided: Array,
    squared: Array,
) -> None:
    """Write the guide, the weight, and the weight times the guide and its square."""
    zero, least = np.float32(0.0), np.float32(1e-9)
    for y in range(trust.shape[0]):
        for x in range(trust.shape[1]):
            n, f = no_flash[y, x], flash[y, x]
            light, flashed = max(n[0] + n[1] + n[2], zero), max(f[0] + f[1] + f[2], zero)
            guide[y, x] = light / max(light + flashed, least)
            weight[y, x] = trust[y, x] + np.float32(1e-6)
            guided[y, x] = weight[y, x] * guide[y, x]
            squared[y, x] = guided[y, x] * guide[y, x]


@njit(cache=True, error_model="numpy")
def _to_variance(total: Array, mean: Array, variance: Array) -> None:
    """Turn means of weight, of weighted guide and of its square into mean and variance."""
    for y in range(total.shape[0]):
        for x in range(total.shape[1]):
            mean[y, x] /= total[y, x]
            spread = variance[y, x] / total[y, x] - mean[y, x] * mean[y, x]
            variance[y, x] = max(spread, np.float32(0.0))


@njit(cache=True, error_model="numpy")
def _weigh(
    one: Image, channel: int, weight: Array, guide: Array, weighed: Array, guided: Array
) -> None:
    """Write a lamp's proportion of a channel, weighed, and times the guide."""
    for y in range(weight.shape[0]):
        for x in range(weight.shape[1]):
            weighed[y, x] = weight[y, x] * one[y, x, channel]
            guided[y, x] = weighed[y, x] * guide[y, x]


@njit(cache=True, error_model="numpy")
def _to_line(
    offset: Array, slope: Array, total: Array, mean: Array, variance: Array, weight: Array
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


@njit(cache=True, error_model="numpy")
def _write_fitted(
    slope: Array, offset: Array, guide: Array, total: Array, smooth: Image, channel: int
) -> None:
    for y in range(total.shape[0]):
        for x in range(total.shape[1]):
            fitted = (slope[y, x] * guide[y, x] + offset[y, x]) / total[y, x]
            smooth[y, x, channel] = fitted


@njit(cache=True, error_model="numpy")
def _blend(proportions: Array, uncertainty: Array, smooth: Array) -> None:
    """Complete the fitted proportions, and go from the given ones as far as noise allows."""
    zero, one, tolerance = np.float32(0.0), np.float32(1.0), np.float32(_TOLERANCE)
    count = len(smooth)
    for y in range(uncertainty.shape[0]):
        for x in range(uncertainty.shape[1]):
            most = zero
            for k in range(3):
                left, total = one, zero
                for j in range(count - 1):
                    left -= smooth[j, y, x, k]
                smooth[count - 1, y, x, k] = left
                for j in range(count):
                    smooth[j, y, x, k] = min(max(smooth[j, y, x, k], zero), one)
                    total += smooth[j, y, x, k]
                total = max(total, np.float32(1e-6))
                for j in range(count):
                    smooth[j, y, x, k] = smooth[j, y, x, k] / total - proportions[j, y, x, k]
                    most = max(most, abs(smooth[j, y, x, k]))
            noise = uncertainty[y, x] * uncertainty[y, x]
            share = noise / max(noise + (tolerance * most) * (tolerance * most), np.float32(1e-12))
            for j in range(count):
                for k in range(3):
                    smooth[j, y, x, k] = proportions[j, y, x, k] + share * smooth[j, y, x, k]
