"""Fills gaps of a picture from ever wider surroundings."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import Floats32


def push_pull(values: Floats32, weight: Floats32) -> Floats32:
    """Fill gaps from ever wider surroundings (Gortler et al., "The Lumigraph", 1996).

    Parameters
    ----------
    values : (h, w, C)
    weight : (h, w) 0…1, how much of a pixel is known

    Returns
    -------
    (h, w, C): values where the weight is 1, a blend with the surroundings elsewhere
    """
    height, width = weight.shape
    if weight.min() >= 1.0:
        return values
    if max(height, width) == 1:
        return values
    size = ((width + 1) // 2, (height + 1) // 2)
    coarse_weight = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    coarse = [
        cv2.resize(values[..., c] * weight, size, interpolation=cv2.INTER_AREA)
        / np.maximum(coarse_weight, 1e-6)
        for c in range(values.shape[2])
    ]
    # a block that is known in part is known as well as need be
    filled = push_pull(np.stack(coarse, axis=-1), np.minimum(4 * coarse_weight, 1.0))
    wide = [
        cv2.resize(
            np.ascontiguousarray(filled[..., c]), (width, height), interpolation=cv2.INTER_LINEAR
        )
        for c in range(values.shape[2])
    ]
    w = weight[..., None]
    return np.asarray(w * values + (1.0 - w) * np.stack(wide, axis=-1), dtype=np.float32)
