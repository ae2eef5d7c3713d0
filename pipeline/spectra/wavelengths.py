"""The wavelengths on which all spectral work is done."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats64

STEP_NM = 5.0
WAVELENGTHS_NM: Floats64 = np.arange(380.0, 781.0, STEP_NM)
"""380 to 780 nm in 5 nm steps, (W,) with W = 81."""
WAVELENGTHS_NM.setflags(write=False)


def on_grid(
    wavelength_nm: ArrayLike, values: ArrayLike, outside: Literal["zero", "hold"]
) -> Floats64:
    """Bring a table of ascending wavelengths onto WAVELENGTHS_NM.

    values: (n,) or (n, k). Returns (W,) or (W, k). Tables of 5 nm and coarser are interpolated
    linearly; those that are finer anywhere are averaged over the 5 nm around each wavelength, so
    that a narrow line keeps its energy. Outside the table the values are zero or hold the last one.
    """
    nm = np.asarray(wavelength_nm, dtype=np.float64)
    columns = np.asarray(values, dtype=np.float64)
    if columns.ndim == 2:
        return np.stack([on_grid(nm, column, outside) for column in columns.T], axis=1)
    ends = {"left": 0.0, "right": 0.0} if outside == "zero" else {}
    if np.diff(nm).min() > STEP_NM - 0.5:
        return np.interp(WAVELENGTHS_NM, nm, columns, **ends)
    fine = np.unique(np.concatenate([nm, _EDGES]))
    power = np.interp(fine, nm, columns, **ends)
    area = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(fine))])
    return np.asarray(np.diff(np.interp(_EDGES, fine, area)) / STEP_NM)


_EDGES = np.append(WAVELENGTHS_NM - STEP_NM / 2, WAVELENGTHS_NM[-1] + STEP_NM / 2)
