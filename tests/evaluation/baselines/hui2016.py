"""A white-balance kernel for every pixel.

Source: Hui, Sankaranarayanan, Sunkavalli and Hadap, "White balance under mixed illumination using
flash photography", ICCP 2016.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Image


def pixel_kernels(
    photograph: Image, flash: Image, flash_white: Floats64, neutral: Floats64
) -> Image:
    """Divide every pixel by the colour of its own light, as flash and lamps show it.

    The light's colour is l = I_nf / I_f · w_f per channel, scaled to sum to that of the neutral
    light, and the result n · I_nf / l: the surface's colour is that of the flash photograph.

    Parameters
    ----------
    photograph : (H, W, 3), I_nf, linear camera RGB
    flash : (H, W, 3), I_f, the flash part alone; where it is not positive the result is 0
    flash_white, neutral : (3,), a white card's colour under the flash, w_f, and under the neutral
        light, n
    """
    lit = (flash > 0).all(axis=2, keepdims=True)
    surface = np.where(lit, flash, 1.0) / flash_white
    light = np.maximum(photograph, 0.0) / surface
    brightness = light.sum(axis=2, keepdims=True) / neutral.sum()
    return np.asarray(np.where(lit, neutral * surface * brightness, 0.0), dtype=np.float32)
