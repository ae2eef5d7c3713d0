"""Ray casting with Lambertian shading and cast shadows; exact light of every lamp.

Axes of the world: x right, y up, z towards the camera's side, metres. The camera looks along its
own −z, x right, y up. Lamps are distant; the flash sits at the camera's lens, so that it casts no
visible shadow, and falls off with the square of the distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.sim.scene import Scene, View
from drivers.sim.shapes import Solid, build

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_SUBSAMPLES = 4  # per side, where a pixel straddles an edge
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
    """What rays met. shape: index, −1 for nothing. normals: world. shading: (n, N+1).

    shading: cosine to each lamp, 0 in shadow; last the flash's, times the fall-off.
    """

    shape: NDArray[np.int8]
    normals: Array
    shading: Array


class Renderer:
    """Renders a scene in blocks of rows.

    lights: how many of the scene's lamps are on. width, height: pixels.
    """

    def __init__(self, scene: Scene, lights: int, width: int, height: int) -> None:
        self.eye = Eye(scene.view, width, height)
        self._shapes = build(scene.shapes)
        self._occluders = [shape for shape in self._shapes if isinstance(shape, Solid)]
        to_lamps = np.array([lamp.direction for lamp in scene.lamps[:lights]])
        self.to_lamps = to_lamps / np.linalg.norm(to_lamps, axis=1, keepdims=True)

    def block(self, rows: slice, colours: Array) -> tuple[Image, Image]:
        """Light that each source sends to each pixel of some rows, and the normals there.

        colours: (shapes, sources, C), what C channels answer to each shape's material facing each
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
            for dy in steps:
                for dx in steps:
                    sub = self._cast(self.eye.rays(grid_x[edges] + dx, grid_y[edges] + dy))
                    light[edges] += _light(sub, colours) / _SUBSAMPLES**2

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

        points = self.eye.position + directions * nearest[:, None]
        normals = np.full(directions.shape, np.nan)
        shading = np.zeros((len(directions), len(self.to_lamps) + 1))
        for shape in self._shapes:
            own = np.flatnonzero(which == shape.index)
            if not len(own):
                continue
            n, p = shape.normals(points[own]), points[own]
            normals[own] = n
            for lamp, to_lamp in enumerate(self.to_lamps):
                shading[own, lamp] = self._reaching(p, n @ to_lamp, to_lamp, shape.index)
            falloff = (self.eye.distance / nearest[own]) ** 2
            shading[own, -1] = np.maximum(-(n * directions[own]).sum(1), 0) * falloff
        return Hits(which, normals, shading)

    def _reaching(self, points: Array, cosine: Array, to_lamp: Array, own: int) -> Array:
        """Put the cosine to 0 where the lamp is hidden. A convex shape never shadows itself."""
        lit = np.flatnonzero(cosine > 0)
        for occluder in self._occluders:
            if occluder.index == own or not len(lit):
                continue
            to = occluder.centre - points[lit]
            along = to @ to_lamp
            beside = (to * to).sum(1) - along**2
            near = np.flatnonzero((beside <= occluder.radius**2) & (along > -occluder.radius))
            blocked = np.isfinite(occluder.enter(points[lit[near]], to_lamp))
            lit = np.delete(lit, near[blocked])
        reaching = np.zeros_like(cosine)
        reaching[lit] = cosine[lit]
        return reaching


def _light(hits: Hits, colours: Array) -> Array:
    """Shading × colour of the material, (n, sources, C); black where nothing was met."""
    return np.where(
        (hits.shape >= 0)[:, None, None], hits.shading[:, :, None] * colours[hits.shape], 0.0
    )


def _straddling(hits: Hits, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels whose neighbours show another shape or other shadows."""
    bits = (hits.shading[:, :-1] > 0) @ (1 << np.arange(hits.shading.shape[1] - 1))
    key = (hits.shape.astype(np.int64) * 8 + bits).reshape(shape)
    edge = np.zeros(shape, bool)
    for axis in (0, 1):
        differs = np.diff(key, axis=axis) != 0
        before = ((0, 1), (0, 0)) if axis == 0 else ((0, 0), (0, 1))
        after = tuple(pad[::-1] for pad in before)
        edge |= np.pad(differs, before) | np.pad(differs, after)
    return edge.ravel()
