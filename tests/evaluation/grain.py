"""Take the grain out of bounced light, which varies slowly over a surface."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32

Stack = Floats32

_REACH = 3  # pixels
_LIKE_NORMALS = 0.95  # cosine


def smooth_bounces(bounced: Stack, reflectance: Stack, normals: Stack, surface: Stack) -> Stack:
    """Average the light that falls on a pixel over its neighbours on the same surface.

    bounced: (B, H, W) light seen, of any number of bands. reflectance: (B, H, W). normals:
    (H, W, 3). surface: (H, W) what the pixel shows, negative where it shows several things; such
    pixels stay as they are. The weights do not depend on light or band, so what is left of the
    grain has the same shape in all of them.
    """
    falling = bounced / np.maximum(reflectance, 1e-4)
    total, weight = np.zeros_like(falling), np.zeros(surface.shape, np.float32)
    height, width = surface.shape
    for dy in range(-_REACH, _REACH + 1):
        for dx in range(-_REACH, _REACH + 1):
            here = np.s_[max(-dy, 0) : height - max(dy, 0), max(-dx, 0) : width - max(dx, 0)]
            there = np.s_[max(dy, 0) : height + min(dy, 0), max(dx, 0) : width + min(dx, 0)]
            like = (surface[here] == surface[there]) & (surface[here] >= 0)
            like &= np.sum(normals[here] * normals[there], axis=2) > _LIKE_NORMALS
            total[(slice(None), *here)] += np.where(like, falling[(slice(None), *there)], 0)
            weight[here] += like
    return np.where(weight > 0, total / np.maximum(weight, 1) * reflectance, bounced)
