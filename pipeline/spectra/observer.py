"""The CIE 1931 standard observer on the grid."""

from __future__ import annotations

from functools import cache

import numpy as np

from pipeline.arrays import Floats64
from pipeline.spectra.colour_science import colour_science
from pipeline.spectra.disk_cache import cached_on_disk
from pipeline.spectra.wavelengths import WAVELENGTHS_NM


@cache
@cached_on_disk
def cie_1931() -> Floats64:
    """CIE 1931 2° colour-matching functions x̄, ȳ, z̄, (3, W), as tabulated at each wavelength."""
    table = colour_science().MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    return np.array([np.interp(WAVELENGTHS_NM, table.wavelengths, c) for c in table.values.T])
