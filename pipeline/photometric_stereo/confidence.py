"""How far the normals of a fitted surface can be trusted."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32
from pipeline.images.frames import Image
from pipeline.photometric_stereo.detail import spread
from pipeline.photometric_stereo.solve import Surface
from pipeline.separation.separation import Strip

_MISFIT = 0.02  # relative light not explained at which half the trust is left
_SLANT = 0.3  # n·z at which half the trust is left
_CUT = 0.2  # trust left where the surface was cut


def normals_confidence(strip: Strip, surface: Surface, normals: Image) -> Floats32:
    """Trust (h, W) in a strip's normals, 0…1; 0 where there are none.

    A product: light against its noise; the share of the lamps that light the pixel, in whose
    shadow or clipped light less is known; the light that the fit leaves over; slant, where a small
    error of depth is a large one of the normal; whether the surface was cut there.
    normals: (h, W, 3) of surface_normals.
    """
    off = np.abs(surface.correction - 1.0).max(axis=2)
    fit = np.where(surface.mask, 1.0 / (1.0 + (off / _MISFIT) ** 2), 0.0)
    lamps = (1.0 + surface.lit.sum(axis=2)) / (1.0 + surface.lit.shape[2])
    trust = fit * lamps * np.where(surface.cut, _CUT, 1.0)
    width = strip.confidence.shape[1]
    own = spread(trust[..., None], surface.block, strip.rows, width)[..., 0]
    facing = np.maximum(normals[..., 2], 0.0) ** 2
    own = own * strip.confidence * facing / (facing + np.float32(_SLANT**2))
    known = np.isfinite(normals).all(axis=2)
    return np.where(known, np.clip(own, 0.0, 1.0), 0.0).astype(np.float32)
