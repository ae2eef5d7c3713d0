"""What a user could take instead: methods without a model of spectra, and an equal split."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Image, Matrix
from pipeline.hui2018.lights import published_lights
from pipeline.vectors import unit

Array = NDArray[np.float64]
Layers = NDArray[np.float32]

_NNMF_ROUNDS = 500
_TINY = 1e-12


def equal_split(photograph: Image, count: int) -> Layers:
    """Layers (count, H, W, 3) that each hold an equal part of the photograph."""
    return np.repeat(photograph[None] / np.float32(count), count, axis=0)


def nnmf(photograph: Image, count: int) -> Layers:
    """Layers (count, H, W, 3) by non-negative factorisation of the photograph alone.

    Pixels × channels ≈ W H, W, H ≥ 0, by the multiplicative updates of Lee and Seung, "Algorithms
    for Non-negative Matrix Factorization", 2001, from a fixed random start; a layer is one column
    of W times one row of H.
    """
    v = np.maximum(photograph.reshape(-1, 3), 0.0).astype(np.float64)
    random = np.random.default_rng(0)
    w = random.uniform(0.5, 1.5, (len(v), count)) * np.sqrt(v.mean())
    h = random.uniform(0.5, 1.5, (count, 3)) * np.sqrt(v.mean())
    for _ in range(_NNMF_ROUNDS):
        h *= (w.T @ v) / (w.T @ w @ h + _TINY)
        w *= (v @ h.T) / (w @ (h @ h.T) + _TINY)
    layers = w.T[:, :, None] * h[:, None, :]
    return np.asarray(layers.reshape(count, *photograph.shape), dtype=np.float32)


def von_kries_matrices(no_flash: Array, flash: Array, count: int) -> Matrix:
    """Matrices (count, 3, 3) of the lamps, diagonal: every channel has a factor of its own.

    Γ is I_nf / I_flash of each channel, scaled to length one, the lamps are those of the published
    Algorithms 1 and 2 on it (Hui et al. 2018). No spectra are needed.
    no_flash, flash: (n, 3), usable pixels, flash the flash part alone. Raises UnusablePairError
    where too few pixels are left.
    """
    lit = (flash > 0).all(axis=1)
    lights = published_lights(unit(no_flash[lit] / flash[lit]), count)
    return np.stack([np.diag(light) for light in np.maximum(lights, 0.0)])
