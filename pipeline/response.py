"""The photograph as another camera would have seen it.

Source: Hui et al. 2018, supplement, camera response editing (fig. 13).
"""

from __future__ import annotations

import numpy as np

from pipeline.frames import Image
from pipeline.lamps import Lamps
from pipeline.model import Response
from pipeline.separation import Strip


def other_response(strip: Strip, lamps: Lamps, response: Response) -> Image:
    """Layers of a strip through another camera's sensitivities, summed; (h, W, 3), its RGB.

    A layer T_j I_f z_j becomes T'_j I_f z_j, with T' of the other camera's model: the constant
    matrix T'_j T_j⁻¹ per lamp, which needs no flash part and so works in every pixel.
    """
    total = np.zeros_like(strip.flash)
    matrices = np.einsum("klj,nj->nkl", response.tensor, lamps.coefficients)
    for layer, here, there in zip(strip.layers, lamps.matrices, matrices, strict=True):
        # T'T⁻¹ by least squares: a lamp that lacks a colour has no sound inverse
        change = there @ np.linalg.pinv(here, rcond=1e-3)
        total += layer @ change.T.astype(np.float32)
    return np.asarray(np.maximum(total, 0.0))
