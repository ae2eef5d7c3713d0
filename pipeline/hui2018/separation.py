"""The published separation, as published. Source: Hui et al. 2018, supplement eq. 2 and 3."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.hui2018.invariant import light_coefficients
from pipeline.shares import shares

Array = NDArray[np.float64]


def published_layers(
    no_flash: NDArray[np.floating], flash: NDArray[np.floating], coefficients: Array, d: Array
) -> NDArray[np.float32]:
    """Layers of the lamps by eq. 3: I_j = ‖β‖ αᵀ E z_j b_j, with Γ = Σ z_j b_j and z ≥ 0.

    Parameters
    ----------
    no_flash, flash : (h, W, 3) linear camera RGB; flash is the flash part alone
    coefficients : (N, 3) unit b_j
    d : (3, 3, 3) from flash_tensor, so that αᵀ E b_j = Σ_l b_jl D_l I_f

    Returns
    -------
    (N, h, W, 3) float32; they need not add up to the photograph, and may be negative
    """
    beta = light_coefficients(no_flash, flash, d)
    length = np.linalg.norm(beta, axis=-1)
    gamma = beta / np.where(length > 0, length, 1.0)[..., None]
    z = shares(
        gamma.astype(np.float32),
        np.broadcast_to(coefficients[:, None, None, :], (len(coefficients), *beta.shape)).astype(
            np.float32
        ),
    )
    matrices = np.einsum("klj,nj->nkl", d, coefficients)
    return np.stack(
        [
            (length * share)[..., None] * (flash @ matrix.T)
            for share, matrix in zip(z, matrices, strict=True)
        ]
    ).astype(np.float32)
