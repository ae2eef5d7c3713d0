"""The published separation, as published.

Source: Hui et al. 2018, supplement, section 2 (the cone of the lights) and eq. 3.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.hui2018.invariant import light_coefficients
from pipeline.light.shares import shares
from pipeline.vectors import unit


def published_layers(
    no_flash: Floats,
    flash: Floats,
    coefficients: Floats64,
    d: Floats64,
    axes: Floats64,
) -> Floats32:
    """Layers of the lamps by eq. 3: I_j = ‖β‖ αᵀ E z_j b_j, with Γ = Σ z_j b_j and z ≥ 0.

    Parameters
    ----------
    no_flash, flash : (h, W, 3) linear camera RGB; flash is the flash part alone
    coefficients : (N, 3) b_j of any length
    d : (3, 3, 3) from flash_tensor, so that αᵀ E b_j = Σ_l b_jl D_l I_f
    axes : (3, 3) from these coefficients to the published coordinates (SpectralBasis.published),
        in which Γ and b_j are unit vectors and light outside their cone goes to what is nearest

    Returns
    -------
    (N, h, W, 3) float32; they need not add up to the photograph, and may be negative
    """
    beta = light_coefficients(no_flash, flash, d) @ axes.T
    length = np.linalg.norm(beta, axis=-1)
    lights = unit(coefficients @ axes.T)
    z = shares(
        unit(beta).astype(np.float32),
        np.broadcast_to(lights[:, None, None, :], (len(lights), *beta.shape)).astype(np.float32),
    )
    matrices = np.einsum("klj,nj->nkl", d, lights @ np.linalg.inv(axes).T)
    return np.stack(
        [
            (length * share)[..., None] * (flash @ matrix.T)
            for share, matrix in zip(z, matrices, strict=True)
        ]
    ).astype(np.float32)
