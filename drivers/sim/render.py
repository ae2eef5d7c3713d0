"""Ray casting with Lambertian shading and cast shadows; exact light of every lamp.

Axes of the world: x right, y up, z towards the camera's side, metres. The camera looks along its
own −z, x right, y up. Lamps are distant discs that shade as their centres would; the flash sits at
the lens, so that it casts no visible shadow, and falls off with the square of the distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.sim.scene import Scene, View
from drivers.sim.shapes import Solid, build

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_SUBSAMPLES = 4  # per side, where a pixel straddles an edge or lies in half-shadow
_LAMP_SAMPLES = 4  # per ray; subsamples see different ones
_POINT_DEG = 0.5  # half the angle that a lamp spans at least in a mirror
_GOLDEN_ANGLE = np.pi * (3 - 5**0.5)
_DIAGONAL_35MM = float(np.hypot(36, 24))


class Eye:
    """A pinhole camera. rotation: (3, 3), rows are its axes in the world."""

    def __init__(self, view: View, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.position = np.array(view.position)
        back = self.position - np.array(view.look_at)
        self.distance = float(np.linalg.norm(back))
        back = back / self.distance
        right = np.cross((0.0, 1.0, 0.0), back)
        right /= np.linalg.norm(right)
        self.rotation = np.stack([right, np.cross(back, right), back])
        self.focal_px = view.focal_35mm * float(np.hypot(width, height)) / _DIAGONAL_35MM

    def rays(self, x: Array, y: Array) -> Array:
        """Cast unit directions in the world, (n, 3), through points in pixels from the top left."""
        at = np.stack(
            [x - self.width / 2, self.height / 2 - y, np.full_like(x, -self.focal_px)], axis=-1
        )
        return np.asarray((at / np.linalg.norm(at, axis=1, keepdims=True)) @ self.rotation)


@dataclass(frozen=True)
class Hits:
    """What rays met. shape, material: indices, −1 for nothing. normals: world. shading: (n, N+1).

    shading: cosine to each lamp times the part of it that is seen; last the flash's, times the
    fall-off.
    half_shadow: where a lamp is seen in part.
    """

    shape: NDArray[np.int8]
    material: NDArray[np.int8]
    normals: Array
    shading: Array
    half_shadow: NDArray[np.bool_]


class Renderer:
    """Renders a scene in blocks of rows.

    lights: how many of the scene's lamps are on. width, height: pixels.
    """

    def __init__(self, scene: Scene, lights: int, width: int, height: int) -> None:
        self.eye = Eye(scene.view, width, height)
        self._shapes = build(scene.shapes)
        names = list(scene.materials)
        self._materials = [
            np.array([names.index(name) for name in shape.materials], np.int8)
            for shape in scene.shapes
        ]
        self._occluders = [shape for shape in self._shapes if isinstance(shape, Solid)]
        to_lamps = np.array([lamp.direction for lamp in scene.lamps[:lights]])
        self._spreads = [np.tan(np.radians(lamp.radius_deg)) for lamp in scene.lamps[:lights]]
        self._mirrors = [shape.mirror for shape in scene.shapes]
        reaches = [max(lamp.radius_deg, _POINT_DEG) for lamp in scene.lamps[:lights]]
        self._reaches = np.radians([*reaches, scene.flash_radius_deg])
        self.to_lamps = to_lamps / np.linalg.norm(to_lamps, axis=1, keepdims=True)
        self._across = [_across(to_lamp) for to_lamp in self.to_lamps]

    def block(self, rows: slice, colours: Array) -> tuple[Image, Image]:
        """Light that each source sends to each pixel of some rows, and the normals there.

        colours: (materials, sources, C), what C channels answer to each material that faces each
        lamp, and last the flash at the distance looked at.

        Returns
        -------
        (sources, h, W, C) as an optical low-pass filter ([1 2 1]/4 both ways) lets it through,
        so that edges suit a colour filter mosaic; (h, W, 3) unit normals in camera axes at the
        pixels' centres, NaN where there is no surface.
        """
        width, margin = self.eye.width, 2
        ys = np.arange(rows.start - margin, rows.stop + margin) + 0.5
        xs = np.arange(-margin, width + margin) + 0.5
        shape = (len(ys), len(xs))
        grid_y, grid_x = (axis.ravel() for axis in np.meshgrid(ys, xs, indexing="ij"))
        hits = self._cast(self.eye.rays(grid_x, grid_y))
        light = _light(hits, colours)

        edges = np.flatnonzero(_straddling(hits, shape))
        if len(edges):
            light[edges] = 0
            steps = (np.arange(_SUBSAMPLES) + 0.5) / _SUBSAMPLES - 0.5
            x = (grid_x[edges, None] + steps).ravel()
            for dy in steps:
                y = np.repeat(grid_y[edges] + dy, _SUBSAMPLES)
                sub = _light(self._cast(self.eye.rays(x, y)), colours)
                light[edges] += sub.reshape(-1, _SUBSAMPLES, *sub.shape[1:]).mean(1) / _SUBSAMPLES

        image = light.reshape(*shape, *colours.shape[1:])[1:-1, 1:-1]
        image = (image[:-2] + 2 * image[1:-1] + image[2:]) / 4
        image = (image[:, :-2] + 2 * image[:, 1:-1] + image[:, 2:]) / 4
        normals = (hits.normals @ self.eye.rotation.T).reshape(*shape, 3)
        inner = normals[margin:-margin, margin:-margin].astype(np.float32)
        return np.ascontiguousarray(np.moveaxis(image, 2, 0), np.float32), inner

    def _cast(self, directions: Array) -> Hits:
        nearest = np.full(len(directions), np.inf)
        which = np.full(len(directions), -1, np.int8)
        for shape in self._shapes:
            rays = np.arange(len(directions))
            if isinstance(shape, Solid):  # most rays pass its bounding sphere by
                to = shape.centre - self.eye.position
                along = directions @ to
                rays = np.flatnonzero(to @ to - along**2 <= shape.radius**2)
            t = shape.enter(self.eye.position, directions[rays])
            closer = t < nearest[rays]
            nearest[rays[closer]] = t[closer]
            which[rays[closer]] = shape.index

        material = np.full(len(directions), -1, np.int8)
        normals = np.full(directions.shape, np.nan)
        shading = np.zeros((len(directions), len(self.to_lamps) + 1))
        half_shadow = np.zeros(len(directions), bool)
        for shape in self._shapes:
            own = np.flatnonzero(which == shape.index)
            if not len(own):
                continue
            p = self.eye.position + directions[own] * nearest[own, None]
            n = shape.normals(p)
            normals[own] = n
            names = self._materials[shape.index]
            material[own] = names[shape.cells(p) % len(names)]
            for lamp, to_lamp in enumerate(self.to_lamps):
                seen = self._seen(p, np.flatnonzero(n @ to_lamp > 0), lamp, shape.index)
                shading[own, lamp] = np.maximum(n @ to_lamp, 0) * seen
                half_shadow[own] |= (seen > 0) & (seen < 1)
            falloff = (self.eye.distance / nearest[own]) ** 2
            shading[own, -1] = np.maximum(-np.einsum("ni,ni->n", n, directions[own]), 0) * falloff
            if mirror := self._mirrors[shape.index]:
                shading[own] = (shading[own] > 0) * self._reflected(n, -directions[own], mirror)
        return Hits(which, material, normals, shading, half_shadow)

    def _reflected(self, normals: Array, towards: Array, mirror: float) -> Array:
        """How bright a mirror shows each lamp and last the flash, (n, N+1), by a card facing it."""
        cosine = np.einsum("ni,ni->n", normals, towards)[:, None]
        away = 2 * cosine * normals - towards
        cosines = np.concatenate([away @ self.to_lamps.T, 2 * cosine**2 - 1], axis=1)
        return np.asarray((cosines > np.cos(self._reaches)) * mirror / np.sin(self._reaches) ** 2)

    def _seen(self, points: Array, facing: NDArray[np.intp], lamp: int, own: int) -> Array:
        """Compute which part of a lamp is seen from points on a shape, (n,), 0…1.

        facing: indices of the points that face the lamp; a convex shape shadows all others.
        """
        to_lamp, spread = self.to_lamps[lamp], self._spreads[lamp]
        origins = points[facing]
        seen = np.ones((_LAMP_SAMPLES, len(facing)), bool)
        for occluder in self._occluders:
            if occluder.index == own or not len(facing):
                continue
            to = occluder.centre - origins
            along = to @ to_lamp
            beside = np.einsum("ni,ni->n", to, to) - along**2
            reach = occluder.radius + np.maximum(along, 0) * spread
            near = np.flatnonzero((beside <= reach**2) & (along > -occluder.radius))
            if not len(near):
                continue
            directions = _disc(origins[near], to_lamp, spread, self._across[lamp])
            seen[:, near] &= np.isinf(occluder.enter(origins[near], directions))
        parts = np.zeros(len(points))
        parts[facing] = seen.mean(axis=0)
        return parts


def _across(to_lamp: Array) -> tuple[Array, Array]:
    """Two unit directions across a lamp's own."""
    sideways = np.cross(to_lamp, (0.0, 0.0, 1.0) if abs(to_lamp[2]) < 0.9 else (1.0, 0.0, 0.0))
    sideways /= np.linalg.norm(sideways)
    return sideways, np.cross(to_lamp, sideways)


def _disc(points: Array, to_lamp: Array, spread: float, across: tuple[Array, Array]) -> Array:
    """Aim at samples of a round lamp, (samples, n, 3), turned at random for each point.

    Neighbouring points see different samples, so that their mean has no bands. The turn comes
    from the point itself: a rendering is the same whatever its blocks.
    """
    turn = np.sin(points @ (12989.8, 7823.3, 3771.9)) * 43758.5
    sample = np.arange(_LAMP_SAMPLES)[:, None]
    radius = spread * np.sqrt((sample + 0.5) / _LAMP_SAMPLES)
    angle = turn + sample * _GOLDEN_ANGLE
    sideways, upwards = across
    beside = np.cos(angle)[..., None] * sideways + np.sin(angle)[..., None] * upwards
    return np.asarray(to_lamp + radius[..., None] * beside)


def _light(hits: Hits, colours: Array) -> Array:
    """Shading × colour of the material, (n, sources, C); black where nothing was met."""
    return np.where(
        (hits.shape >= 0)[:, None, None], hits.shading[:, :, None] * colours[hits.material], 0.0
    )


def _straddling(hits: Hits, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Find pixels in half-shadow and those whose neighbours show another shape, material, light."""
    bits = (hits.shading[:, :-1] > 0) @ (1 << np.arange(hits.shading.shape[1] - 1))
    half_shadow = hits.half_shadow.reshape(shape)
    key = (hits.shape.astype(np.int64) << 16) + (hits.material.astype(np.int64) << 8) + bits
    key = key.reshape(shape) * 2 + half_shadow
    edge = half_shadow.copy()
    for axis in (0, 1):
        differs = np.diff(key, axis=axis) != 0
        before = ((0, 1), (0, 0)) if axis == 0 else ((0, 0), (0, 1))
        after = tuple(pad[::-1] for pad in before)
        edge |= np.pad(differs, before) | np.pad(differs, after)
    return edge.ravel()
