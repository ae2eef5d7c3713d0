"""Each lamp's part of every channel of the no-flash photograph, by the model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Image
from pipeline.lamps import Lamps
from pipeline.shares import shares

Array = NDArray[np.float32]


def predictions(flash: Image, lamps: Lamps) -> Array:
    """What each lamp would give where it shines like the flash: T_j I_flash, (N, h, W, 3), ≥ 0."""
    matrices = lamps.matrices.astype(np.float32)
    return np.stack([np.maximum(flash @ matrix.T, 0.0) for matrix in matrices])


def model_proportions(no_flash: Image, flash: Image, lamps: Lamps) -> Array:
    """Parts of the lamps, (N, h, W, 3), 0…1, summing to 1 in each channel.

    no_flash, flash: (h, W, 3) linear camera RGB, flash the flash part alone. Shares are found by
    non-negative least squares in the image, each channel weighed by lamps.channel_weights. Where
    the model gives a channel no light, the parts of the pixel's whole light are taken.
    """
    predicted = predictions(flash, lamps)
    weights = lamps.channel_weights.astype(np.float32)
    z = shares(no_flash * weights, predicted * weights)
    parts = predicted * z[..., None]
    return normalised(parts)


def normalised(parts: Array) -> Array:
    """Parts of the whole, (N, h, W, 3), 0…1, summing to 1 in each channel.

    parts: each lamp's light, ≥ 0. Where a channel has none, the parts of the pixel's whole light
    are taken, and equal ones where there is no light at all.
    """
    total = parts.sum(axis=0)
    whole = parts.sum(axis=-1)
    whole_total = whole.sum(axis=0)
    equal = np.float32(1.0 / len(parts))
    overall = np.where(whole_total > 0, whole / np.where(whole_total > 0, whole_total, 1), equal)
    return np.where(total > 0, parts / np.where(total > 0, total, 1), overall[..., None])
