"""Rooms full of things, a chart or sphere among them, photographed with and without flash.

Everything follows from the seed: what lies about, where the target is and how it is turned, the
colours of two lamps, the fall-off of the flash, blur and noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.options import Circle
from pipeline.spectra.colorchecker import colorchecker_spectra
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.vectors import unit
from tests.evaluation.spectra import sensitivities

Target = Literal["chart", "matt", "mirror", "none"]

SIZE = (720, 480)
CAMERA = "Nikon D5100"
FOCAL_PX = 1.3 * SIZE[0]
LAMPS = ("A", "FL2", "FL11", "D65", "LED-B1", "LED-B5", "Incandescent", "Kinoton 75P")
FLASHES = ("xenon", "LED-B5", "LED-B4", "D65")
_WELL, _READ_NOISE, _WHITE = 20_000.0, 5.0, 0.8
_SUB = 2
_PATCH, _FRAME = 0.43, 0.85  # by the distance of two patches' middles
_CHART = np.array([[0, 0], [5, 0], [5, 3], [0, 3]], np.float64)


@dataclass(frozen=True)
class Room:
    """frames: (no flash, flash), (H, W, 3) linear. corners: of a chart's outer patches.

    circle: middle and area of the ellipse that a sphere's outline is. directions: (2, 3) to the
    lamps. colours: (2, 3) of a white card that faces them. flash: (W,), its spectrum.
    """

    frames: tuple[Floats64, Floats64]
    corners: Floats64 | None
    circle: Circle | None
    directions: Floats64
    colours: Floats64
    flash: Floats64


@dataclass(frozen=True)
class Plan:
    """How hard it is made. share: the target's width by the picture's. tilt_deg, blur_px: at most.

    targets: how many of them. cut: how much of the target is beyond the picture's edge, or covered.
    exposure: what the brightest value is, 1 the white level. shadow: the flash does not reach the
    target.
    """

    share: tuple[float, float] = (0.25, 0.6)
    tilt_deg: float = 35.0
    blur_px: float = 1.0
    targets: int = 1
    cut: float = 0.0
    exposure: float = _WHITE
    shadow: bool = False


def photograph_room(target: Target, seed: int, plan: Plan | None = None) -> Room:
    """Photograph a room, the target somewhere in it."""
    plan = plan or Plan()
    random = np.random.default_rng([seed, len(target), ord(target[0])])
    width, height = SIZE
    what = _clutter(random)
    palette = np.vstack([reflectance_spectra(), colorchecker_spectra(), _flat(0.035), _flat(0.18)])
    first = len(reflectance_spectra())
    sensitivity = sensitivities(CAMERA)
    flash = find_light(FLASHES[seed % len(FLASHES)])
    corners, circle = None, None
    for number in range(plan.targets if target == "chart" else 0):
        corners = _placed(random, plan, number)
        _draw_chart(what, corners, first)
        if plan.cut:
            _cover(what, corners, plan.cut, int(random.integers(first)))
    y, x = (np.mgrid[: height * _SUB, : width * _SUB] + 0.5) / _SUB
    directions, colours = _lamps(random, sensitivity)
    white = sensitivity @ flash
    by_flash = (palette @ (sensitivity * flash / white[1]).T)[what]
    seen = np.clip(palette @ sensitivity.T / sensitivity.sum(axis=1), 0, 1)
    sides = [0.6 + 0.4 * (x / width - 0.5) * 2 * np.sign(d[0]) for d in directions]
    by_lamps = sum(
        seen[what] * colour * side[..., None] for colour, side in zip(colours, sides, strict=True)
    )
    far = np.hypot(x - random.uniform(0.3, 0.7) * width, y - 0.5 * height) / width
    by_flash = by_flash / (1 + 1.5 * far**2)[..., None]
    by_lamps = np.asarray(by_lamps) * 0.5
    if target in ("matt", "mirror"):
        circle = _place_sphere(random, plan)
        draw_sphere = _matt if target == "matt" else _mirror
        draw_sphere(by_lamps, by_flash, circle, directions, colours * 0.5, white / white[1])
        circle = _outline(circle)
    if plan.shadow and corners is not None:
        dark = np.zeros(what.shape, np.uint8)
        middle = corners.mean(axis=0)
        cv2.fillConvexPoly(dark, _pixels(middle + 2.2 * (corners - middle)), 1)
        by_flash[dark.astype(bool)] = 0
    room = _exposed(_shrunk(by_lamps), _shrunk(by_flash), random, plan)
    return replace(
        Room(room, corners, circle, directions, colours, flash),
    )


def _flat(level: float) -> Floats64:
    return np.full((1, colorchecker_spectra().shape[1]), level)


def _clutter(random: np.random.Generator) -> NDArray[np.int32]:
    """Indices of reflectances: a wall, and boxes, discs and chequered cloths before it."""
    width, height = SIZE[0] * _SUB, SIZE[1] * _SUB
    some = len(reflectance_spectra())
    what = np.full((height, width), int(random.integers(some)), np.int32)
    for _ in range(24):
        middle = random.uniform((0, 0), (width, height))
        half = random.uniform(0.02, 0.16, 2) * width
        turn = random.uniform(0, 180)
        kind = random.integers(4)
        colour = int(random.integers(some))
        if kind == 0:
            axes = (int(half[0]), int(half[random.integers(2)]))
            centre = (int(middle[0]), int(middle[1]))
            cv2.ellipse(what, centre, axes, turn, 0, 360, colour, -1)
            continue
        columns, rows = (int(random.integers(2, 6)), int(random.integers(2, 5)))
        if kind < 3:
            columns, rows = 1, 1
        colours = random.integers(some, size=(rows, columns))
        along = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
        across = np.array([-along[1], along[0]])
        gap = 0.9 if columns * rows > 1 else 1.0
        for (row, column), cell in np.ndenumerate(colours):
            at = middle + along * half[0] * (2 * (column + 0.5) / columns - 1)
            at = at + across * half[1] * (2 * (row + 0.5) / rows - 1)
            a, b = along * half[0] / columns * gap, across * half[1] / rows * gap
            quad = np.array([at - a - b, at + a - b, at + a + b, at - a + b])
            cv2.fillConvexPoly(what, np.round(quad).astype(np.int32), int(cell))
    return what


def _placed(random: np.random.Generator, plan: Plan, number: int) -> Floats64:
    """Corners in the picture of a chart, turned and tilted at random."""
    size = np.ptp(_CHART, axis=0)
    for _ in range(10_000):
        turn, tilt = random.uniform(0, 2 * np.pi), np.radians(random.uniform(0, plan.tilt_deg))
        about = random.uniform(0, 2 * np.pi)
        share = random.uniform(*plan.share) / (1 if plan.targets == 1 else 2)
        flat = (_CHART - _CHART.mean(axis=0)) / size[0]
        turned = flat @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        away = turned @ (np.cos(about), np.sin(about))
        along = np.outer(away * (np.cos(tilt) - 1), (np.cos(about), np.sin(about)))
        distance = FOCAL_PX / (share * SIZE[0])
        depth = distance + away * np.sin(tilt)
        quad = FOCAL_PX * (turned + along) / depth[:, None]
        low, high = (0.0, 1.0) if plan.targets == 1 else (number / 2, (number + 1) / 2)
        quad = quad + random.uniform((low * SIZE[0], 0), (high * SIZE[0], SIZE[1]))
        middle = quad.mean(axis=0)
        outer = middle + 1.55 * (quad - middle)
        inside = ((outer >= 0) & (outer <= SIZE)).all()
        between = (outer[:, 0] >= low * SIZE[0]).all() and (outer[:, 0] <= high * SIZE[0]).all()
        if inside and between:
            return np.asarray(quad)
    raise AssertionError("the target does not fit into the picture")


def _draw_chart(what: NDArray[np.int32], corners: Floats64, first: int) -> None:
    to_picture = cv2.getPerspectiveTransform(_CHART.astype(np.float32), corners.astype(np.float32))

    def quad(x: float, y: float, half: tuple[float, float]) -> NDArray[np.int32]:
        around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half + (x, y)
        return _pixels(cv2.perspectiveTransform(around[None], to_picture.astype(np.float64))[0])

    cv2.fillConvexPoly(what, quad(2.5, 1.5, (2.5 + _FRAME, 1.5 + _FRAME)), first + 24)
    for index in range(24):
        place = quad(index % 6, index // 6, (_PATCH, _PATCH))
        cv2.fillConvexPoly(what, place, first + index)


def _cover(what: NDArray[np.int32], corners: Floats64, share: float, colour: int) -> None:
    """Lay something over the left share of a chart."""
    a, b, c, d = corners + 0.25 * (corners - corners.mean(axis=0))
    quad = np.array([a, a + share * (b - a), d + share * (c - d), d])
    cv2.fillConvexPoly(what, _pixels(quad), colour)


def _pixels(corners: Floats64) -> NDArray[np.int32]:
    return np.round(np.asarray(corners) * _SUB - 0.5).astype(np.int32)


def _lamps(random: np.random.Generator, sensitivity: Floats64) -> tuple[Floats64, Floats64]:
    """Directions (2, 3) and colours (2, 3) of two lamps, one from either side."""
    names = random.choice(len(LAMPS), 2, replace=False)
    spectra = np.array([find_light(LAMPS[n]) for n in names])
    colours = spectra @ sensitivity.T
    colours *= random.uniform(0.4, 0.8, (2, 1)) / colours[:, 1:2]
    tilted = random.uniform((0.3, -0.3, 0.25), (0.9, 0.7, 0.9), (2, 3)) * [[-1, 1, 1], [1, 1, 1]]
    return unit(tilted), colours


def _place_sphere(random: np.random.Generator, plan: Plan) -> Circle:
    """Middle and long semi-axis of the ellipse that the outline of a sphere is."""
    radius = random.uniform(*plan.share) * SIZE[0] / 4
    x, y = random.uniform((1.1 * radius, 1.1 * radius), np.array(SIZE) - 1.1 * radius)
    return Circle(x=float(x), y=float(y), radius=float(radius))


def _outline(placed: Circle) -> Circle:
    """Middle and area of the ellipse whose long semi-axis was placed."""
    offset = np.hypot(placed.x - SIZE[0] / 2, SIZE[1] / 2 - placed.y) / FOCAL_PX
    near, far = (np.arctan(offset + sign * placed.radius / FOCAL_PX) for sign in (-1, 1))
    short = FOCAL_PX * np.sin((far - near) / 2) / np.sqrt(np.cos(near) * np.cos(far))
    return Circle(x=placed.x, y=placed.y, radius=float(np.sqrt(placed.radius * short)))


def _surface(
    circle: Circle, shape: Sequence[int]
) -> tuple[NDArray[np.bool_], Floats64, Floats64, Floats64]:
    """Where the sphere is, its normals there, the directions to the camera, and distances.

    circle: middle and long semi-axis of its outline.
    """
    y, x = (np.mgrid[: shape[0], : shape[1]] + 0.5) / _SUB
    middle = np.array([circle.x - SIZE[0] / 2, SIZE[1] / 2 - circle.y]) / FOCAL_PX
    offset, reach = float(np.hypot(*middle)), circle.radius / FOCAL_PX
    near, far = np.arctan(offset - reach), np.arctan(offset + reach)
    axis, half = (near + far) / 2, (far - near) / 2
    centre = np.array([*(middle / max(offset, 1e-12) * np.sin(axis)), -np.cos(axis)])
    rays = unit(
        np.stack(
            [(x - SIZE[0] / 2) / FOCAL_PX, (SIZE[1] / 2 - y) / FOCAL_PX, -np.ones_like(x)], axis=-1
        )
    )
    along = rays @ centre
    root = np.sin(half) ** 2 - 1 + along**2
    hit = root > 0
    distance = along[hit] - np.sqrt(root[hit])
    return hit, unit(rays[hit] * distance[:, None] - centre), -rays[hit], distance


def _matt(
    by_lamps: Floats64,
    by_flash: Floats64,
    circle: Circle,
    towards: Floats64,
    colours: Floats64,
    white: Floats64,
) -> None:
    hit, normals, to_camera, distance = _surface(circle, by_lamps.shape)
    facing = (normals * to_camera).sum(axis=1) / distance**2
    by_lamps[hit] = 0.5 * np.maximum(normals @ towards.T, 0) @ colours
    by_flash[hit] = 0.5 * facing[:, None] * white


def _mirror(
    by_lamps: Floats64,
    by_flash: Floats64,
    circle: Circle,
    towards: Floats64,
    colours: Floats64,
    white: Floats64,
) -> None:
    """A ball of black glass that reflects a twenty-fifth, in lamps of 5° radius."""
    hit, normals, to_camera, _ = _surface(circle, by_lamps.shape)
    cosine = (normals * to_camera).sum(axis=1, keepdims=True)
    away = 2 * cosine * normals - to_camera
    reach = np.radians(5.0)
    room = 0.02 + 0.02 * np.sin(9 * away[:, :1]) * np.sin(7 * away[:, 1:2])
    lit = np.repeat(room, 3, axis=1) * 0.3
    for direction, colour in zip(towards, colours, strict=True):
        lit[away @ direction > np.cos(reach)] = colour * 0.04 / np.sin(reach) ** 2
    by_lamps[hit] = lit
    flash = np.repeat(room, 3, axis=1) * 0.2 * white
    flash[(away * to_camera).sum(axis=1) > np.cos(0.03)] = white * 0.04 / np.sin(0.03) ** 2
    by_flash[hit] = flash


def _shrunk(picture: Floats64) -> Floats64:
    return np.asarray(cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA))


def _exposed(
    lamps: Floats64, flash: Floats64, random: np.random.Generator, plan: Plan
) -> tuple[Floats64, Floats64]:
    scale = plan.exposure / np.quantile(lamps + flash, 0.999)
    blur = random.uniform(0, plan.blur_px)
    frames = []
    for picture in (lamps, lamps + flash):
        seen = cv2.GaussianBlur(picture, (0, 0), max(blur, 1e-3)) * scale
        electrons = random.poisson(np.clip(seen, 0, 4) * _WELL)
        read = _READ_NOISE * random.standard_normal(seen.shape)
        frames.append(np.clip((electrons + read) / _WELL, -0.01, 1.0))
    return frames[0], frames[1]
