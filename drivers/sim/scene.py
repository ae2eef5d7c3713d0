"""What a scene file says: camera, lamps, flash, materials and shapes."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field

Vector = tuple[float, float, float]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class View(_Strict):
    """Where the camera stands. Lengths in metres; focal length as on 35 mm film."""

    position: Vector
    look_at: Vector
    focal_35mm: float = Field(gt=0)


class Lamp(_Strict):
    """A distant round lamp.

    radius_deg: half the angle it spans; it makes the shadows soft.
    light: name among colour-science's measured light sources. through: reflectance of a card that
    it is bounced off. direction: towards the lamp, world axes. strength: green response of a white
    card facing it, relative to the other lamps.
    """

    name: str
    light: str
    through: str | None = None
    direction: Vector
    radius_deg: float = Field(default=0.0, ge=0, lt=45)
    strength: float = Field(gt=0)


class Shape(_Strict):
    """A sphere, box or cylinder, scaled and turned, or the sweep they stand on.

    materials: one name, or several that repeat, cell by cell, over a pattern. pattern: columns
    and rows of cells, left to right and bottom to top; columns go around a sphere or cylinder.
    gap: share of a cell's width that is between it and the next, of the material after the cells'.
    half: half sizes along x, y, z in metres. turn, tilt, roll: degrees about the vertical, then
    about the x and z axes. A sweep is a floor through its centre that curves up into a wall:
    half = (any, radius of the curve, distance of the wall behind the centre). mirror: share of
    the light that it reflects as a mirror, in place of being matt; it shows lamps and flash alone.
    """

    kind: Literal["sphere", "box", "cylinder", "sweep"]
    materials: tuple[str, ...] = Field(min_length=1)
    pattern: tuple[int, int] = (1, 1)
    centre: Vector
    half: Vector
    turn: float = 0.0
    tilt: float = 0.0
    roll: float = 0.0
    gap: float = Field(default=0.0, ge=0, lt=1)
    mirror: float = Field(default=0.0, ge=0, le=1)


class Scene(_Strict):
    """A scene. materials: name → measured reflectance.

    highlight: the brightest value of the flash photograph, white = 1. flash: green response of
    a white card at the point looked at, facing the flash, on the scale of the lamps' strengths.
    flash_radius_deg: half the angle that it spans in mirrors.
    """

    version: Literal[1]
    view: View
    highlight: float = Field(gt=0, lt=1)
    flash: float = Field(gt=0)
    flash_radius_deg: float = Field(default=6.0, gt=0, lt=45)
    lamps: tuple[Lamp, ...]
    materials: dict[str, str]
    shapes: tuple[Shape, ...]


@cache
def load_scene(name: str) -> Scene:
    """Load one of the scenes that lie beside this module."""
    text = (Path(__file__).parent / f"{name}.yaml").read_text(encoding="utf-8")
    return Scene.model_validate(yaml.safe_load(text))
