"""Random geometries of several kinds, each the same for the same seed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations
from typing import Literal, get_args

import numpy as np

from pipeline.arrays import Floats64
from tests.evaluation.geometry import Geometry, Kind, Lamp, Shape, Vector, View
from tests.evaluation.patterns import Pattern

Layout = Literal["room", "corner", "smooth", "close", "panels", "wall"]
_LAYOUTS = get_args(Layout)

PALETTE = 40
"""Colours a scene may use; the first _LIGHT of them are light ones, for walls and floors."""
LIGHT = 8

_OBJECTS: tuple[Kind, ...] = ("box", "sphere", "ellipsoid", "cylinder", "cone", "vase", "torus")
_ROUND: tuple[Kind, ...] = ("sphere", "ellipsoid")
_FLASH_BESIDE_LENS = 0.06
_PANEL, _PANEL_COLOURS = 2.4, 12
_TRIES = 1000
_PERSON_AWAY = 3.0  # metres before the camera, from which a person's place is told
_PERSON_COLOUR = 15


def make_geometry(layout: Layout, seed: int, lamps: int) -> Geometry:
    """Geometry with so many lamps, the flash the last of them.

    room: a floor, a back wall and 5 to 12 things on it. corner: two walls at right angles close
    around 4 to 7 things, where light bounces. smooth: one to three round things in the dark, none
    of which casts a shadow on another. close: a room whose things fill much of the picture.
    panels: two painted walls that meet, all of which all lamps light, so that none is ever alone.
    wall: a room whose lamps stand before its back wall, where the camera looks.
    """
    random = np.random.default_rng([seed, _LAYOUTS.index(layout)])
    paints = _paints(random)
    if layout == "smooth":
        return _smooth(random, paints, lamps)
    if layout == "panels":
        return _panels(random, lamps)
    view = View(
        position=(random.uniform(-0.6, 0.6), random.uniform(1.0, 1.9), random.uniform(3.6, 4.4)),
        look_at=(random.uniform(-0.1, 0.1), random.uniform(0.3, 0.45), -0.2),
    )
    spread_deg = 200.0
    floor = _plane((0, 0, 0), 6.0, _background(random), tilt=-90)
    if layout in ("room", "close", "wall"):
        walls = [_plane((0, 0, random.uniform(-2.4, -1.7)), 6.0, _background(random))]
    if layout == "room":
        things = _things(random, paints, int(random.integers(5, 13)), 1.3, (-1.3, 1.1))
    elif layout == "wall":  # in front of the lamps
        things = _things(random, paints, int(random.integers(5, 13)), 1.3, (-0.3, 1.1))
    elif layout == "close":
        view = replace(view, fov_deg=26.0)
        things = _things(random, paints, 6, 0.7, (-0.7, 0.7), (0.25, 0.42))
    else:
        walls = [
            _plane((side * 2.2, 0, 0.4), 3.6, _background(random), turn=-side * 45)
            for side in (-1.0, 1.0)
        ]
        things = _things(random, paints, int(random.integers(4, 8)), 0.9, (-0.9, 0.9))
        spread_deg = 120.0  # in front of both walls
    if layout == "wall":
        around = _lamps_before(random, lamps, walls[0].centre[2])
    else:
        around = _lamps_around(random, lamps, spread_deg)
    return Geometry((floor, *walls, *things), (*around, _flash(random, view)), view)


def _smooth(random: np.random.Generator, paints: Iterator[Pattern], lamps: int) -> Geometry:
    view = View(position=(0.0, 0.0, 4.0), look_at=(0.0, 0.0, 0.0), fov_deg=30.0)
    for _try in range(_TRIES):
        shapes = _side_by_side(random, paints)
        chosen = tuple(_lamp_towards(random) for _lamp in range(lamps))
        apart = all(
            _angle(np.array(a.centre), np.array(b.centre)) > 35 for a, b in combinations(chosen, 2)
        )
        if apart and not any(_shadows(lamp, shapes) for lamp in chosen):
            return Geometry(shapes, (*chosen, _flash(random, view)), view)
    raise ValueError(f"no place for {lamps} lamps that cast no shadow")


def _panels(random: np.random.Generator, lamps: int) -> Geometry:
    view = View(position=(0.0, 0.0, 4.0), look_at=(0.0, 0.0, 0.0))
    shapes = []
    for side in (-1.0, 1.0):
        colours = tuple(int(c) for c in random.permutation(PALETTE)[:_PANEL_COLOURS])
        cells, seed = int(random.integers(12, 24)), int(random.integers(1 << 31))
        pattern = Pattern("patches", colours, cells, seed)
        bend = np.radians(random.uniform(4, 14))
        centre = _vector(_PANEL * np.array([side * np.cos(bend), 0.0, np.sin(bend)]))
        turn = -side * float(np.degrees(bend))
        shapes.append(Shape("plane", centre, (_PANEL,) * 3, pattern, turn, plastic=False))
    turns = np.radians(np.linspace(-40, 40, lamps) + random.uniform(-12, 12, lamps))
    around = []
    for turn in random.permutation(turns):
        high, away = np.radians(random.uniform(-5, 40)), random.uniform(2.4, 4.0)
        beside = away * np.cos(high)
        centre = beside * np.sin(turn), away * np.sin(high), beside * np.cos(turn)
        around.append(Lamp(_vector(np.array(centre)), random.uniform(0.01, 0.08)))
    return Geometry(tuple(shapes), (*around, _flash(random, view)), view)


def _side_by_side(random: np.random.Generator, paints: Iterator[Pattern]) -> tuple[Shape, ...]:
    count = int(random.integers(1, 4))
    radius = {1: 0.75, 2: 0.48, 3: 0.32}[count]
    shapes = []
    for i in range(count):
        x = (i - (count - 1) / 2) * 2.15 / count
        size = radius * random.uniform(0.7, 1.0, 3)
        kind = _ROUND[int(random.integers(2))]
        shapes.append(
            Shape(
                kind,
                (x, random.uniform(-0.1, 0.1), 0.0),
                (radius,) * 3 if kind == "sphere" else (size[0], size[1], size[2]),
                next(paints),
                turn_deg=random.uniform(0, 360),
                tilt_deg=random.uniform(-40, 40),
            )
        )
    return tuple(shapes)


def _shadows(lamp: Lamp, shapes: tuple[Shape, ...]) -> bool:
    """Whether a thing may stand between a lamp and another thing, by their bounding spheres."""
    at = np.array(lamp.centre)
    for a, b in combinations(shapes, 2):
        to_a, to_b = np.array(a.centre) - at, np.array(b.centre) - at
        wide = np.degrees(
            np.arcsin(max(a.size) / np.linalg.norm(to_a))
            + np.arcsin(max(b.size) / np.linalg.norm(to_b))
        )
        if _angle(to_a, to_b) < wide:
            return True
    return False


def _lamp_towards(random: np.random.Generator) -> Lamp:
    """Lamp 3 to 6 m away, somewhere before the things."""
    tilt, turn = np.radians(random.uniform(10, 85)), random.uniform(0, 2 * np.pi)
    away = random.uniform(3, 6)
    return Lamp(
        _vector(
            away
            * np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
        )
    )


def _lamps_around(random: np.random.Generator, count: int, spread_deg: float) -> tuple[Lamp, ...]:
    """Lamps spread around the things, from side to side, 20° to 60° high, 1.8 to 3.5 m away."""
    sector = spread_deg / count
    middle = (np.arange(count) + 0.5) * sector - spread_deg / 2
    turns = np.radians(random.permutation(middle + random.uniform(-0.35, 0.35, count) * sector))
    lamps = []
    for turn in turns:
        high, away = np.radians(random.uniform(20, 60)), random.uniform(1.8, 3.5)
        beside = away * np.cos(high)
        centre = (beside * np.sin(turn), 0.4 + away * np.sin(high), beside * np.cos(turn))
        lamps.append(Lamp(_vector(np.array(centre)), random.uniform(0.01, 0.08)))
    return tuple(lamps)


def _lamps_before(random: np.random.Generator, count: int, wall: float) -> tuple[Lamp, ...]:
    """Lamps side by side 0.4 to 0.9 m before a wall at a depth."""
    beside = np.linspace(-0.7, 0.7, count) + random.uniform(-0.2, 0.2, count)
    return tuple(
        Lamp((float(x), random.uniform(0.6, 1.4), wall + random.uniform(0.4, 0.9)), 0.05)
        for x in random.permutation(beside)
    )


def _flash(random: np.random.Generator, view: View) -> Lamp:
    beside = _FLASH_BESIDE_LENS * np.array([random.choice([-1, 0, 1]), 1, 0])
    return Lamp(_vector(np.array(view.position) + beside))


def _things(
    random: np.random.Generator,
    paints: Iterator[Pattern],
    count: int,
    reach: float,
    depth: tuple[float, float],
    radii: tuple[float, float] = (0.14, 0.4),
) -> list[Shape]:
    """Things that stand on the floor beside each other."""
    taken: list[tuple[float, float, float]] = []
    things: list[Shape] = []
    for _try in range(_TRIES):
        if len(things) == count:
            break
        radius = random.uniform(*radii)
        x, z = random.uniform(-reach, reach), random.uniform(*depth)
        if all(np.hypot(x - a, z - b) > radius + r for a, b, r in taken):
            taken.append((x, z, radius))
            things.append(_thing(random, next(paints), x, z, radius))
    return things


def _thing(
    random: np.random.Generator, pattern: Pattern, x: float, z: float, radius: float
) -> Shape:
    kind = _OBJECTS[int(random.integers(len(_OBJECTS)))]
    tall = radius * random.uniform(0.6, 1.6)
    wide = radius / 2**0.5 if kind == "box" else radius
    tilt = 0.0
    size, centre = (wide, tall, wide), (x, tall, z)
    if kind == "sphere":
        size, centre = (radius, radius, radius), (x, radius, z)
    elif kind == "torus":  # lies, or stands on its rim
        size, centre = (radius, radius, radius), (x, 0.3 * radius, z)
        if random.random() < 0.5:
            tilt, centre = 90.0, (x, radius, z)
    turn = random.uniform(0, 360)
    return Shape(kind, centre, size, pattern, turn, tilt, int(random.integers(1 << 31)))


def _plane(
    centre: Vector, size: float, pattern: Pattern, turn: float = 0.0, tilt: float = 0.0
) -> Shape:
    return Shape("plane", centre, (size,) * 3, pattern, turn, tilt, plastic=False)


def _background(random: np.random.Generator) -> Pattern:
    """Walls and floors: light colours, plain, textured, tiled or striped."""
    kind = random.choice(["plain", "texture", "checker", "stripes"], p=[0.3, 0.4, 0.15, 0.15])
    colours = tuple(int(c) for c in random.permutation(LIGHT)[:3])
    seed = int(random.integers(1 << 31))
    makers: dict[str, Callable[[], Pattern]] = {
        "plain": lambda: Pattern("plain", colours[:1]),
        "texture": lambda: Pattern("texture", colours, 3, seed),
        "checker": lambda: Pattern("checker", colours[:2], int(random.integers(16, 40)) * 2),
        "stripes": lambda: Pattern("stripes", colours, int(random.integers(16, 40)) * 3),
    }
    return makers[str(kind)]()


def _paints(random: np.random.Generator) -> Iterator[Pattern]:
    """Patterns for things, from all colours, none used twice before all were."""
    colours: list[int] = []
    kinds = ["plain", "plain", "texture", "texture", "checker", "stripes", "patches"]
    while True:
        if len(colours) < 6:
            colours += [int(c) for c in random.permutation(PALETTE)]
        kind = random.choice(kinds)
        count = {"plain": 1, "texture": 3, "checker": 2, "stripes": 3, "patches": 6}[str(kind)]
        own, colours = tuple(colours[:count]), colours[count:]
        seed, cells = int(random.integers(1 << 31)), int(random.integers(2, 6))
        if kind == "plain":
            yield Pattern("plain", own)
        elif kind == "texture":
            yield Pattern("texture", own, 1, seed)
        elif kind == "checker":
            yield Pattern("checker", own, 2 * cells)
        elif kind == "stripes":
            yield Pattern("stripes", own, 3 * cells)
        else:
            yield Pattern("patches", own, 2 * cells, seed)


def _vector(values: Floats64) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])


def _angle(a: Floats64, b: Floats64) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def moved(geometry: Geometry, widths: float, seed: int) -> Geometry:
    """Move the camera, with its flash, as a hand does between two photographs.

    widths: how far the picture shifts, in widths of it. The camera turns, rolls so that the sides
    move half as far, and wanders 4 mm for each 1/256 of a width, which gives parallax.
    """
    random = np.random.default_rng([seed, 1])
    view = geometry.view
    position, look_at = np.array(view.position), np.array(view.look_at)
    across = 2 * np.tan(np.radians(view.fov_deg / 2)) * np.linalg.norm(look_at - position)
    turn = random.uniform(0, 2 * np.pi)
    shift = widths * across * np.array([np.cos(turn), np.sin(turn), 0.0])
    wander = random.standard_normal(3)
    wander *= 0.004 * 256 * widths / np.linalg.norm(wander)
    roll = random.choice([-1, 1]) * np.degrees(widths)
    seen = View(
        _vector(position + wander),
        _vector(look_at + wander + shift),
        view.fov_deg,
        view.roll_deg + float(roll),
    )
    flash = geometry.lamps[-1]
    carried = replace(flash, centre=_vector(np.array(flash.centre) + wander))
    return replace(geometry, view=seen, lamps=(*geometry.lamps[:-1], carried))


def with_somebody(geometry: Geometry, place: float) -> Geometry:
    """Add a person of an ellipsoid's shape, 1.5 m tall, behind the nearest things.

    place: of its middle, in widths of the picture to the right of the picture's own.
    """
    view = geometry.view
    across = 2 * np.tan(np.radians(view.fov_deg / 2)) * _PERSON_AWAY
    look = Pattern("plain", (_PERSON_COLOUR,))
    person = Shape("ellipsoid", (float(place * across), 0.75, 1.0), (0.22, 0.75, 0.15), look)
    return replace(geometry, shapes=(*geometry.shapes, person))
