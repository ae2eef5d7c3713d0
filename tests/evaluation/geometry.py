"""Where things stand: shapes, lamps and the camera of a scene, as data.

Axes of the world: x right, y up, z towards the camera, metres.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from tests.evaluation.patterns import Pattern

Vector = tuple[float, float, float]
Kind = Literal["plane", "box", "sphere", "ellipsoid", "cylinder", "cone", "vase", "torus"]


@dataclass(frozen=True)
class Shape:
    """A shape about its own centre, scaled, tilted about x, turned about y, then moved.

    kind: a plane is a square of side 2 facing z, all others fit a cube of side 2; shapes of
    revolution stand along y. seed: of a vase's profile.
    plastic: under a roughness it gets a gloss; walls and floors stay matte.
    """

    kind: Kind
    centre: Vector
    size: Vector
    pattern: Pattern
    turn_deg: float = 0.0
    tilt_deg: float = 0.0
    seed: int = 0
    plastic: bool = True


@dataclass(frozen=True)
class Lamp:
    """A small round lamp. centre: metres. radius: metres, 0 for a point."""

    centre: Vector
    radius: float = 0.0


@dataclass(frozen=True)
class View:
    """A camera. fov_deg: across the picture. roll_deg: clockwise seen from behind the camera."""

    position: Vector = (0.0, 1.4, 4.0)
    look_at: Vector = (0.0, 0.4, -0.2)
    fov_deg: float = 38.0
    roll_deg: float = 0.0


@dataclass(frozen=True)
class Geometry:
    """A scene without its spectra.

    depth: longest path from lamp to camera in segments, 2 for direct light alone; None for
    light that is followed until it has died away. roughness: α of plastic shapes, None for matte.
    """

    shapes: tuple[Shape, ...]
    lamps: tuple[Lamp, ...]
    view: View = field(default_factory=View)
    depth: int | None = 2
    roughness: float | None = None
