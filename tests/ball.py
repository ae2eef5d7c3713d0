"""A ball before the camera, under distant lamps and a flash, computed from first principles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.options import DirectedLight
from pipeline.photometric_stereo.grid import Grid, make_grid
from pipeline.photometric_stereo.scene import Scene, State
from pipeline.spectra.lights import find_light, reflectance_spectra
from tests.turned import turned

LAMPS = ("A", "FL2", "D100")


@dataclass(frozen=True)
class Ball:
    """All (size, size, …). lamps: (J, size, size, 3) each alone. inside: bool, off the rim."""

    focal_px: float
    normals: Floats64
    depth: Floats64
    flash: Floats64
    lamps: Floats64
    inside: NDArray[np.bool_]
    directions: Floats64
    colours: Floats64

    @property
    def light(self) -> Floats64:
        return np.asarray(self.lamps.sum(axis=0))

    @property
    def lit(self) -> NDArray[np.bool_]:
        return np.asarray((self.lamps.sum(axis=3) > 0).all(axis=0) & self.inside)

    @property
    def grid(self) -> Grid:
        middle = len(self.depth) / 2 - 0.5
        return make_grid(self.inside, self.focal_px, (middle, middle))

    def lights(self, *said: str) -> list[DirectedLight]:
        """The lamps as a user describes them, by direction and what is said beside it."""
        return [
            DirectedLight(
                direction=tuple(direction),
                strength=float(colour[1]) if "strength" in said else None,
                rgb=tuple(colour) if "rgb" in said else None,
            )
            for direction, colour in zip(self.directions, self.colours, strict=True)
        ]

    def turned(self, degrees: float) -> Ball:
        """The same, its directions given off by so much, each to another side."""
        return replace(self, directions=turned(self.directions, degrees))

    def error(self, normals: Floats64, where: NDArray[np.bool_]) -> float:
        """Mean angle in degrees."""
        cosine = np.clip((normals * self.normals).sum(axis=2), -1, 1)
        return float(np.degrees(np.arccos(cosine))[where].mean())

    def error_of(self, scene: Scene, state: State, where: NDArray[np.bool_]) -> float:
        """The same of a fit."""
        field = np.full(self.normals.shape, np.nan)
        w = scene.grid.w(state.h)
        field[scene.grid.mask] = w / np.linalg.norm(w, axis=1, keepdims=True)
        return self.error(field, where)


def make_ball(sensitivities: Floats64, size: int = 48, materials: int = 1, lamps: int = 3) -> Ball:
    """Build a ball of radius 0.4 at a distance of 2, seen through a sensor's own sensitivities.

    size: of the picture in pixels, which it nearly fills. materials: painted as a chequer board.
    lamps: how many of LAMPS.
    """
    focal = 2.2 * size
    y, x = np.mgrid[:size, :size] - (size / 2 - 0.5)
    ray = np.stack([x / focal, -y / focal, -np.ones_like(x)], axis=-1)
    centre = np.array([0.0, 0.0, -2.0])
    a, b = (ray**2).sum(axis=2), ray @ centre
    root = b**2 - a * (4 - 0.4**2)
    inside = root > 0.02 * root.max()
    depth = (b - np.sqrt(np.maximum(root, 0))) / a
    place = depth[..., None] * ray
    normals = (place - centre) / 0.4
    distance = np.linalg.norm(place, axis=2)
    facing = (normals * -place).sum(axis=2) / distance
    directions = np.array([[-0.6, 0.35, 0.7], [0.65, 0.3, 0.7], [0.05, -0.55, 0.8]])[:lamps]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rho = reflectance_spectra()
    light = np.flatnonzero(rho.mean(axis=1) > 0.3)
    palette = rho[np.random.default_rng(5).choice(light, materials, replace=False)]
    cells = np.floor((normals[..., :2] + 1) * 3).astype(int)
    which = (cells[..., 0] + 2 * cells[..., 1]) % materials

    def seen(spectrum: Floats64) -> Floats64:
        return np.asarray(
            (palette @ (sensitivities * spectrum).T)[which] / (sensitivities[1] @ spectrum)
        )

    shading = np.maximum(normals @ directions.T, 0) * np.array([1.0, 0.7, 1.2])[:lamps]
    spectra = [find_light(name) for name in LAMPS[:lamps]]
    dark = ~inside[..., None]
    lit = [
        np.where(dark, 0, seen(spectrum) * shading[..., j, None])
        for j, spectrum in enumerate(spectra)
    ]
    flash = seen(find_light("xenon")) * (facing / distance**2)[..., None]
    colours = [
        sensitivities @ spectrum / (sensitivities[1] @ spectrum) * strength
        for spectrum, strength in zip(spectra, (1.0, 0.7, 1.2), strict=False)
    ]
    return Ball(
        focal,
        normals,
        depth,
        np.where(dark, 0, flash),
        np.array(lit),
        inside,
        directions,
        np.array(colours),
    )


def before_a_wall(ball: Ball, distance: float = 3.3) -> Ball:
    """The same ball, of one material, before a wall of it, on which it casts its shadows.

    The picture shows half as much again in both directions.
    """
    border = len(ball.depth) // 4
    wide = len(ball.depth) + 2 * border
    y, x = np.mgrid[:wide, :wide] - (wide / 2 - 0.5)
    ray = np.stack([x / ball.focal_px, -y / ball.focal_px, -np.ones_like(x)], axis=-1)
    from_centre = distance * ray - np.array([0.0, 0.0, -2.0])
    aside = np.linalg.norm(np.cross(from_centre[..., None, :], ball.directions), axis=-1)
    shading = np.moveaxis(ball.directions[:, 2] * (aside > 0.4), 2, 0)
    middle = (len(ball.depth) // 2,) * 2
    facing = ball.directions @ ball.normals[middle]
    lamps = shading[..., None] * (ball.lamps[:, *middle] / facing[:, None])[:, None, None]
    card = ball.flash[middle] * ball.depth[middle] ** 2
    flash = card * (distance / (distance * np.linalg.norm(ray, axis=2)) ** 3)[..., None]

    def behind(wall: Floats64, thing: Floats64) -> Floats64:
        """What the wall shows, but where the ball hides it; (..., H, W, n) of both."""
        shown = wall.copy()
        inner = shown[..., border : wide - border, border : wide - border, :]
        inner[...] = np.where(ball.inside[..., None], thing, inner)
        return shown

    return replace(
        ball,
        normals=behind(np.broadcast_to([0.0, 0.0, 1.0], ray.shape), ball.normals),
        depth=behind(np.full((wide, wide, 1), distance), ball.depth[..., None])[..., 0],
        flash=behind(flash, ball.flash),
        lamps=behind(lamps, ball.lamps),
        inside=np.ones((wide, wide), bool),
    )
