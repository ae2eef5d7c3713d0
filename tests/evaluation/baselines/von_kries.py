"""The published method without spectra: every channel of a lamp has a factor of its own.

Source: Hui et al., CVPR 2018, with Γ of every channel by itself.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.hui2018.lights import published_lights
from pipeline.images.frames import Matrix
from pipeline.vectors import unit


def von_kries_matrices(no_flash: Floats64, flash: Floats64, count: int) -> Matrix:
    """Matrices (count, 3, 3) of the lamps, diagonal: every channel has a factor of its own.

    Γ is I_nf / I_flash of each channel, scaled to length one, the lamps are those of the published
    Algorithms 1 and 2 on it (Hui et al. 2018). No spectra are needed.
    no_flash, flash: (n, 3), usable pixels, flash the flash part alone. Raises UnusablePairError
    where too few pixels are left.
    """
    lit = (flash > 0).all(axis=1)
    lights = published_lights(unit(no_flash[lit] / flash[lit]), count)
    return np.stack([np.diag(light) for light in np.maximum(lights, 0.0)])
