"""The reflectance invariant: what the light of a pixel is, whatever its surface.

Source: Hui et al. 2018, supplement eq. 1 and section 1; tensor form of the same.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats, Floats64


def flash_tensor(tensor: Floats64, flash: Floats64, seen_by: Floats64 | None = None) -> Floats64:
    """Fold the flash into the model: D with I_nf = Σ_j β_j D[:, :, j] I_f.

    Parameters
    ----------
    tensor : (3, 3, 3) model E[k, i, j], channel, reflectance, light
    flash : (3,) coefficients f of the flash's spectrum
    seen_by : (3, 3, 3) model E of another camera in the same bases, which then sees I_nf

    Returns
    -------
    (3, 3, 3) D[k, l, j]: I_f = (Σ_j E_j f_j) α gives α, and E_j α = D_j I_f.
    """
    seen = tensor if seen_by is None else seen_by
    from_flash = np.linalg.inv(tensor @ flash)
    return np.stack([seen[:, :, j] @ from_flash for j in range(3)], axis=2)


def light_coefficients(no_flash: Floats, flash: Floats, d: Floats64) -> Floats64:
    """β of every pixel: the light of the no-flash photograph, relative to the flash's shading.

    Parameters
    ----------
    no_flash, flash : (..., 3) linear camera RGB; flash is the flash part alone
    d : (3, 3, 3) from flash_tensor

    Returns
    -------
    (..., 3) β from the 3×3 system I_nf = Σ_j β_j D_j I_f (Cramer's rule); 0 where it is singular.
    """
    columns = [_by_channel(flash @ d[:, :, j].T) for j in range(3)]
    crossed = [_cross(columns[(j + 1) % 3], columns[(j + 2) % 3]) for j in range(3)]
    determinant = _dot(columns[0], crossed[0])
    scale = np.prod([np.sqrt(_dot(column, column)) for column in columns], axis=0)
    solvable = np.abs(determinant) > 1e-9 * scale  # relative, so that dark pixels count too
    safe = np.where(solvable, determinant, 1.0)
    light = _by_channel(no_flash)
    return np.stack([np.where(solvable, _dot(light, c) / safe, 0.0) for c in crossed], axis=-1)


def _by_channel(pixels: Floats) -> Floats64:
    """(..., 3) as (3, ...), on which NumPy is several times as fast."""
    return np.ascontiguousarray(np.moveaxis(pixels, -1, 0), dtype=np.float64)


def _cross(a: Floats64, b: Floats64) -> Floats64:
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _dot(a: Floats64, b: Floats64) -> Floats64:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
