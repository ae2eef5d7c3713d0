"""The 24 patches of the ColorChecker Classic."""

from __future__ import annotations

from functools import cache

import numpy as np

from pipeline.arrays import Floats64
from pipeline.spectra.colour_science import colour_science
from pipeline.spectra.disk_cache import cached_on_disk
from pipeline.spectra.wavelengths import on_grid

ROWS, COLUMNS = 4, 6


@cache
@cached_on_disk
def colorchecker_spectra() -> Floats64:
    """Reflectances (24, W), 0 to 1, row by row from dark skin to black (average of BabelColor)."""
    patches = colour_science().SDS_COLOURCHECKERS["BabelColor Average"].values()
    return np.array([on_grid(patch.wavelengths, patch.values, "hold") for patch in patches])
