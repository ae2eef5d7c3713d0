"""A surface as if it had been fitted."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from pipeline.photometric_stereo.detail import surface_normals
from pipeline.photometric_stereo.facing import Facing
from pipeline.photometric_stereo.solve import Surface


def wall(known: NDArray[np.bool_], depth: float, lamps: int) -> Facing:
    """A wall that faces the camera. known: (H, W), where it is."""
    surface = Surface(
        block=1,
        mask=known,
        cut=np.zeros_like(known),
        w=np.where(known[..., None], [0.0, 0.0, 2.0], 0.0),
        z=np.where(known, depth, 0.0),
        lit=np.ones((*known.shape, lamps)),
        deviations=np.zeros((*known.shape, lamps, 3)),
        correction=np.ones((*known.shape, lamps)),
        directions=np.eye(3),
        matrices=np.zeros((lamps, 3, 3)),
        misfit=0.0,
        unexplained=0.0,
        strengths=np.ones(lamps),
        turned_deg=0.0,
        focal_px=100.0,
    )
    return Facing(partial(surface_normals, surface=surface), surface.strengths, surface)
