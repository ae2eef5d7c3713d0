"""What is known of where surfaces face: what normals and depth are made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipeline.arrays import Floats64
from pipeline.images.frames import Image
from pipeline.run_warnings import RunWarning
from pipeline.separation.separation import Strip

if TYPE_CHECKING:  # solving for normals takes long to import, and few ask for it
    from pipeline.photometric_stereo.solve import Surface

CONVENTIONS = {
    "gl": "x right, y up, z to the viewer (OpenGL)",
    "dx": "x right, y down, z to the viewer (DirectX)",
}
"""Axes of the normals that are written, by the option normals."""


@dataclass(frozen=True)
class Facing:
    """Where surfaces face.

    normals_of: of a strip, (h, W, 3), unit, x right, y up, z to the viewer, NaN where unknown.
    strengths: (J,) of the lamps, relative. surface: what was fitted, None as published. warnings:
    that the lamps do not explain the light.
    """

    normals_of: Callable[[Strip], Image]
    strengths: Floats64
    surface: Surface | None
    warnings: tuple[RunWarning, ...] = ()
