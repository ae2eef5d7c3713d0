"""Non-negative factorisation of the photograph alone.

Source: Lee and Seung, "Algorithms for Non-negative Matrix Factorization", NIPS 2001.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32
from pipeline.images.frames import Image

_ROUNDS = 500
_TINY = 1e-12


def nnmf(photograph: Image, count: int) -> Floats32:
    """Layers (count, H, W, 3), each one column of W times one row of H.

    Pixels × channels ≈ W H, W, H ≥ 0, by multiplicative updates from a fixed random start.
    """
    v = np.maximum(photograph.reshape(-1, 3), 0.0).astype(np.float64)
    random = np.random.default_rng(0)
    w = random.uniform(0.5, 1.5, (len(v), count)) * np.sqrt(v.mean())
    h = random.uniform(0.5, 1.5, (count, 3)) * np.sqrt(v.mean())
    for _ in range(_ROUNDS):
        h *= (w.T @ v) / (w.T @ w @ h + _TINY)
        w *= (v @ h.T) / (w @ (h @ h.T) + _TINY)
    layers = w.T[:, :, None] * h[:, None, :]
    return np.asarray(layers.reshape(count, *photograph.shape), dtype=np.float32)
