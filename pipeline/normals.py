"""Surface normals, by the method asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Image
from pipeline.hui2018.normals import normals, solve_photometry
from pipeline.lamps import Lamps
from pipeline.model import Model
from pipeline.options import DirectedLight
from pipeline.photometric_stereo.detail import surface_normals
from pipeline.photometric_stereo.responses import LampBank
from pipeline.photometric_stereo.solve import Surface, solve_surface
from pipeline.reduced import ReducedPair
from pipeline.separation import Strip


@dataclass(frozen=True)
class Facing:
    """Where surfaces face.

    of: unit normals (h, W, 3) of a strip, x right, y up, z to the viewer, NaN where unknown.
    strengths: (3,) of the lamps, relative. surface: its depth, None as published.
    """

    of: Callable[[Strip], Image]
    strengths: NDArray[np.float64]
    surface: Surface | None


def find_facing(
    lights: Sequence[DirectedLight],
    reduced: ReducedPair,
    lamps: Lamps,
    model: Model,
    bank: LampBank,
    focal_px: float,
    method: Literal["best", "paper"],
) -> Facing:
    """Solve for what normals need; see solve_surface ("best") and solve_photometry ("paper").

    Raises OptionError for directions nearly in a plane, and where there are not three lamps;
    UnusablePairError where hardly anything is lit.
    """
    if method == "paper":
        photometry = solve_photometry(lights, reduced, lamps, model, focal_px)
        of = partial(normals, lamps=lamps, photometry=photometry)
        return Facing(of, photometry.strengths, None)
    surface = solve_surface(lights, reduced, lamps, model, bank, focal_px)
    return Facing(partial(surface_normals, surface=surface), surface.strengths, surface)
