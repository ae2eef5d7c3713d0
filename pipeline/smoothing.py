"""Smooths proportions of light where the light is smooth, and keeps the edges of shadows."""

from __future__ import annotations

import cv2
import numpy as np
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
    light, flashed = (np.maximum(image.sum(axis=2), 0.0) for image in (no_flash, flash))
    guide = light / np.maximum(light + flashed, 1e-9)
    weight = trust + np.float32(1e-6)
    total = _box(weight)
    mean = _box(weight * guide) / total
    variance = np.maximum(_box(weight * guide * guide) / total - mean * mean, 0.0)
    smooth = np.empty((len(proportions), *proportions[0, keep].shape), dtype=np.float32)
    for lamp, one in enumerate(proportions):
        for channel in range(3):
            p = one[..., channel]
            p_mean = _box(weight * p) / total
            slope = (_box(weight * guide * p) / total - mean * p_mean) / (variance + _EPSILON)
            offset = p_mean - slope * mean
            fitted = (_box(weight * slope) * guide + _box(weight * offset)) / total
            smooth[lamp, ..., channel] = np.clip(fitted[keep], 0.0, 1.0)
    smooth /= np.maximum(smooth.sum(axis=0), 1e-6)
    change = smooth - proportions[:, keep]
    noise = np.square(uncertainty[keep])
    largest = np.square(_TOLERANCE * np.abs(change).max(axis=(0, 3)))
    share = noise / np.maximum(noise + largest, 1e-12)
    return np.asarray(proportions[:, keep] + share[..., None] * change)


def _box(plane: Array) -> Array:
    # not cv2.blur, whose running sums round differently in every strip
    mean = cv2.sepFilter2D(plane, -1, _KERNEL, _KERNEL, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(mean, dtype=np.float32)
