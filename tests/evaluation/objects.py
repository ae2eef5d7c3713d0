"""Objects under distant lamps and a flash at the camera, whose normals and depth are known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.spectra.lights import find_light
from tests.evaluation.capture import Sensor, expose, tiff
from tests.evaluation.geometry import Geometry, Lamp, Shape, Vector, View
from tests.evaluation.patterns import Pattern
from tests.evaluation.render import Facing, render_facing
from tests.evaluation.scenes import WHITE_LEVEL
from tests.evaluation.spectra import Split, flash_spectrum, lamps, reflectances, sensitivities
from tests.evaluation.transport import DirectTransport

Kind = Literal["measured", "peaked", "filtered"]

CAMERA = "Nikon D5100"
SIZE = (192, 192)

_VIEW = View(position=(0.0, 0.0, 2.0), look_at=(0.0, 0.0, 0.0), fov_deg=30.0)
_FAR = 300.0  # metres
_FLASH = 8.8  # on a white card at 1 m, against lamps of about 1
_COLOURS = 6
_LIGHT = 0.2  # mean reflectance of the colours, at least
_LEAST_ANGLE_DEG = 8.0  # between two lamps' camera colours
_PEAKED = 12  # how many lamps are: those of the least effective width 5 nm/Σp²
_SATURATED = 5.0  # largest ÷ least reflectance of what a filter is made of


@dataclass(frozen=True)
class Object:
    """name: its own. shapes: as in Geometry. directions: (3, 3) to the lamps."""

    name: str
    shapes: tuple[Shape, ...]
    directions: tuple[tuple[float, float, float], ...]

    @property
    def materials(self) -> int:
        """How many colours it is painted with."""
        return len({colour for shape in self.shapes for colour in shape.pattern.colours})


@dataclass(frozen=True)
class ObjectShot:
    """A pair of files, what is known of the lamps, and the truth.

    options: for Options. lights: for light_directions, with direction, strength and rgb. normals:
    (H, W, 3), NaN outside. depth: (H, W) along the camera's axis. lit: bool (H, W), by all lamps.
    """

    files: tuple[bytes, bytes]
    options: dict[str, Any]
    lights: list[dict[str, Any]]
    normals: Floats64
    depth: Floats64
    lit: NDArray[np.bool_]


_PLAIN = Pattern("plain", (0,))
_ABOVE = ((-0.6, 0.35, 0.7), (0.65, 0.3, 0.7), (0.05, -0.55, 0.8))
_BELOW = ((-0.5, -0.4, 0.75), (0.6, -0.25, 0.75), (0.1, 0.65, 0.75))
_ASKEW = ((0.2, 0.6, 0.77), (-0.65, -0.1, 0.75), (0.55, -0.4, 0.73))


def _one(
    kind: Any, pattern: Pattern, size: Vector = (0.42, 0.42, 0.42), **more: Any
) -> tuple[Shape, ...]:
    return (Shape(kind, (0.0, 0.0, 0.0), size, pattern, **more),)


def _some(
    kind: Literal["checker", "stripes", "patches"], colours: int, cells: int, seed: int
) -> Pattern:
    return Pattern(kind, tuple(range(colours)), cells, seed)


def _one_before_another(number: int) -> Object:
    """A shape before another, drawn at random: painted, or each of one colour."""
    random = np.random.default_rng([number, 991])
    at, apart = random.uniform(0, 2 * np.pi), random.uniform(0.18, 0.28)
    across = np.array([np.cos(at), np.sin(at)]) * apart
    kind = random.choice(["sphere", "vase", "ellipsoid"])
    behind = _drawn(random, kind, (*-0.4 * across, -0.12), random.uniform(0.27, 0.38))
    kind = random.choice(["sphere", "ellipsoid", "torus", "vase"])
    place = (*0.7 * across, random.uniform(0.2, 0.38))
    before = _drawn(random, kind, place, random.uniform(0.14, 0.21))
    directions = (_ABOVE, _BELOW, _ASKEW)[random.integers(3)]
    return Object(f"one before another {number}", (behind, before), directions)


def _drawn(random: np.random.Generator, kind: Any, place: Any, side: float) -> Shape:
    x, y, z = (float(one) for one in place)
    size = (side, side, side)
    if kind == "ellipsoid":
        size = (side, side * random.uniform(0.6, 0.9), side * random.uniform(0.6, 0.9))
    painted: Any = random.choice(["plain", "checker", "stripes", "patches"], p=[0.25] * 4)
    colours = tuple(int(colour) for colour in random.permutation(_COLOURS))
    many = {
        "plain": 1,
        "checker": int(random.integers(2, 5)),
        "stripes": int(random.integers(2, 6)),
        "patches": int(random.integers(3, 7)),
    }[str(painted)]
    pattern = Pattern("plain", colours[:1])
    if painted != "plain":
        cells, seed = int(random.integers(4, 9)), int(random.integers(1, 99))
        pattern = Pattern(painted, colours[:many], cells, seed)
    turn = float(random.uniform(0, 90))
    tilt = float(random.uniform(40, 70) if kind == "torus" else random.uniform(-25, 25))
    seed = int(random.integers(1, 99))
    return Shape(kind, (x, y, z), size, pattern, turn, tilt, seed)


OBJECTS: dict[Split, tuple[Object, ...]] = {
    "development": (
        Object("ball", _one("sphere", _PLAIN), _ABOVE),
        Object("vase", _one("vase", _PLAIN, tilt_deg=25, seed=4), _BELOW),
        Object("patched ball", _one("sphere", _some("patches", 6, 6, 3)), _BELOW),
        Object(
            "striped vase",
            _one("vase", _some("stripes", 5, 10, 1), tilt_deg=20, turn_deg=30, seed=7),
            _ASKEW,
        ),
        Object("chequered ring", _one("torus", _some("checker", 4, 6, 1), tilt_deg=60), _ABOVE),
        Object(
            "patched egg",
            _one(
                "ellipsoid", _some("patches", 6, 5, 8), (0.45, 0.3, 0.3), tilt_deg=15, turn_deg=35
            ),
            _ASKEW,
        ),
        Object(
            "ball before a vase",
            (
                Shape("vase", (0.12, 0.0, -0.2), (0.42,) * 3, _some("patches", 5, 6, 2), seed=5),
                Shape("sphere", (-0.2, -0.15, 0.25), (0.2,) * 3, _some("stripes", 3, 6, 1)),
            ),
            _BELOW,
        ),
        Object(
            "plain balls",
            (
                Shape("sphere", (0.16, 0.1, -0.1), (0.27,) * 3, _PLAIN),
                Shape("sphere", (-0.12, -0.1, 0.35), (0.18,) * 3, _PLAIN),
            ),
            _ABOVE,
        ),
        *(_one_before_another(number) for number in range(12)),
    ),
    "report": (
        Object("egg", _one("ellipsoid", _PLAIN, (0.3, 0.45, 0.32), tilt_deg=-20), _ASKEW),
        Object("ring", _one("torus", _PLAIN, tilt_deg=75), _BELOW),
        Object("slender vase", _one("vase", _PLAIN, tilt_deg=-15, seed=13), _ABOVE),
        Object("chequered ball", _one("sphere", _some("checker", 5, 8, 2), tilt_deg=30), _ASKEW),
        Object(
            "patched vase",
            _one("vase", _some("patches", 6, 7, 5), tilt_deg=-25, turn_deg=50, seed=21),
            _BELOW,
        ),
        Object(
            "striped egg",
            _one(
                "ellipsoid",
                _some("stripes", 6, 12, 4),
                (0.32, 0.45, 0.32),
                tilt_deg=30,
                turn_deg=20,
            ),
            _ABOVE,
        ),
        Object("patched ring", _one("torus", _some("patches", 5, 6, 9), tilt_deg=65), _ASKEW),
        Object(
            "two balls",
            (
                Shape("sphere", (-0.14, 0.05, -0.1), (0.3,) * 3, _some("patches", 6, 5, 11)),
                Shape("sphere", (0.2, -0.12, 0.3), (0.2,) * 3, _some("checker", 4, 6, 1)),
            ),
            _ABOVE,
        ),
    ),
}


def photograph(
    thing: Object,
    split: Split,
    kind: Kind = "measured",
    flash: str = "xenon",
    noise: bool = False,
    on: tuple[int, ...] = (0, 1, 2),
) -> ObjectShot:
    """Photograph an object under lamps of a kind; the same each time.

    measured: lamps of the split. peaked: those of narrow bands alone. filtered: lamps behind
    coloured filters. on: which of the three are lit. noise: of the usual sensor.
    """
    number = [one.name for one in OBJECTS[split]].index(thing.name)
    random = np.random.default_rng([number, len(kind), 3 if split == "report" else 1])
    s = sensitivities(CAMERA)
    transport, facing = _rendered(thing)
    light = np.flatnonzero(reflectances(split).mean(axis=1) > _LIGHT)
    palette = reflectances(split)[random.choice(light, _COLOURS, replace=False)]
    spectra = _lamps(random, split, kind, s)
    strengths = random.uniform(0.7, 1.4, 3)
    lit = sum(
        transport.picture(j, _response(spectra[j], s, strengths[j]), palette) * _FAR**2 for j in on
    )
    flash_part = transport.picture(3, _response(flash_spectrum(flash), s, _FLASH), palette)
    both = lit + flash_part
    scale = WHITE_LEVEL / np.percentile(both.max(axis=2)[facing.lit[3]], 99.9)
    frames = [lit * scale, both * scale]
    if noise:
        frames = [expose(frame, Sensor(), random) for frame in frames]
    colours = spectra @ s.T
    directions = np.array(thing.directions)
    return ObjectShot(
        files=(tiff(frames[0], exact=not noise), tiff(frames[1], exact=not noise)),
        options={
            "camera": CAMERA,
            "flash_spectrum": flash,
            "encoding": "linear",
            "focal_px": SIZE[0] / 2 / np.tan(np.radians(_VIEW.fov_deg / 2)),
        },
        lights=[
            {
                "direction": directions[j].tolist(),
                "strength": float(strengths[j]),
                "rgb": (colours[j] / colours[j].max()).tolist(),
            }
            for j in range(3)
        ],
        normals=facing.normals,
        depth=_VIEW.position[2] - facing.places[..., 2],
        lit=np.all(facing.lit[list(on)], axis=0),
    )


@cache
def _rendered(thing: Object) -> tuple[DirectTransport, Facing]:
    directions = np.array(thing.directions)
    far = _FAR * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    lights = [Lamp((float(x), float(y), float(z))) for x, y, z in [*far, _VIEW.position]]
    return render_facing(Geometry(thing.shapes, tuple(lights), _VIEW), SIZE)


def _lamps(random: np.random.Generator, split: Split, kind: Kind, s: Floats64) -> Floats64:
    """Three spectra (3, W) whose colours differ."""
    known = lamps(split).spectra
    if kind == "peaked":
        known = known[np.argsort(-np.sum(known**2, axis=1), kind="stable")[:_PEAKED]]
    if kind == "filtered":
        rho = reflectances(split)
        filters = rho[rho.max(axis=1) > _SATURATED * (rho.min(axis=1) + 0.02)]
        plain = np.array([find_light(name) for name in ("A", "D65", "LED-B3", "FL7")])
        chosen = random.choice(len(filters), 60, replace=False)
        known = plain[random.integers(0, 4, 60)] * filters[chosen] ** random.integers(1, 3, (60, 1))
    for _ in range(10_000):
        three = known[random.choice(len(known), 3, replace=False)]
        colours = three @ s.T
        colours /= np.linalg.norm(colours, axis=1, keepdims=True)
        nearest = max(colours[0] @ colours[1], colours[0] @ colours[2], colours[1] @ colours[2])
        if nearest < np.cos(np.radians(_LEAST_ANGLE_DEG)):
            return np.asarray(three)
    raise ValueError(f"no three {kind} lamps differ enough")


def _response(spectrum: Floats64, s: Floats64, strength: float) -> Floats64:
    response = spectrum[:, None] * s.T
    return np.asarray(strength * response / response[:, 1].sum())
