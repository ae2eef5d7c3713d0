"""Types of arrays of numbers, of any shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats32 = NDArray[np.float32]
"""What there is of every pixel."""
Floats64 = NDArray[np.float64]
"""What there is little of: matrices, spectra, figures of blocks and lamps."""
Floats = NDArray[np.floating]
"""Either."""
