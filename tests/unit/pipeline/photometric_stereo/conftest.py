"""A ball before the camera, under distant lamps and a flash, computed from first principles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.options import DirectedLight
from pipeline.photometric_stereo.grid import Grid, make_grid
from pipeline.photometric_stereo.materials import find_materials
from pipeline.photometric_stereo.objective import with_even_albedo
from pipeline.photometric_stereo.responses import LampBank
from pipeline.photometric_stereo.scene import Scene, State
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light, reflectance_spectra

Array = NDArray[np.float64]

LAMPS = ("A", "FL2", "D100")


@dataclass(frozen=True)
class Ball:
    """All (size, size, …). lamps: (J, size, size, 3) each alone. inside: bool, off the rim."""

    focal_px: float
    normals: Array
    depth: Array
    flash: Array
    lamps: Array
    inside: NDArray[np.bool_]
    directions: Array
    colours: Array

    @property
    def light(self) -> Array:
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

    def error(self, normals: Array, where: NDArray[np.bool_]) -> float:
        """Mean angle in degrees."""
        cosine = np.clip((normals * self.normals).sum(axis=2), -1, 1)
        return float(np.degrees(np.arccos(cosine))[where].mean())


@pytest.fixture(scope="session")
def ball(camera: Camera) -> Callable[..., Ball]:
    """Build a ball of radius 0.4 at a distance of 2, seen through a sensor's own sensitivities.

    size: of the picture in pixels, which it nearly fills. materials: painted as a chequer board.
    lamps: how many of LAMPS.
    """

    def build(size: int = 48, materials: int = 1, lamps: int = 3) -> Ball:
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
        s = camera.sensitivities

        def seen(spectrum: Array) -> Array:
            return np.asarray((palette @ (s * spectrum).T)[which] / (s[1] @ spectrum))

        shading = np.maximum(normals @ directions.T, 0) * np.array([1.0, 0.7, 1.2])[:lamps]
        spectra = [find_light(name) for name in LAMPS[:lamps]]
        dark = ~inside[..., None]
        lit = [
            np.where(dark, 0, seen(spectrum) * shading[..., j, None])
            for j, spectrum in enumerate(spectra)
        ]
        flash = seen(find_light("xenon")) * (facing / distance**2)[..., None]
        colours = [
            s @ spectrum / (s[1] @ spectrum) * strength
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

    return build


@pytest.fixture(scope="session")
def bank(camera: Camera) -> LampBank:
    """Lamps as that camera sees them, under a xenon flash."""
    return LampBank(camera.sensitivities, find_light("xenon"))


@pytest.fixture(scope="session")
def scene_of(bank: LampBank) -> Callable[..., Scene]:
    """What is known of a ball. variance: of every light."""

    def build(ball: Ball, variance: float = 1e-10) -> Scene:
        mask = ball.inside
        flash, light = ball.flash[mask], ball.light[mask]
        chromaticity = flash[:, :2] / flash.sum(axis=1, keepdims=True)
        return Scene(
            ball.grid,
            ball.directions,
            flash,
            light,
            np.full_like(light, variance),
            tuple(bank.prior(colour) for colour in ball.colours),
            find_materials(chromaticity, 0.008),
        )

    return build


@pytest.fixture(scope="session")
def true_state() -> Callable[..., State]:
    """The surface as it is, lamps and materials as is usual."""

    def build(ball: Ball, scene: Scene) -> State:
        size = len(ball.depth)
        y, x = np.mgrid[: size + 1, : size + 1] - size / 2
        ray = np.stack([x, -y, np.full_like(x, -ball.focal_px)], axis=-1) / ball.focal_px
        a, b = (ray**2).sum(axis=2), 2.0
        h = ((b - np.sqrt(np.maximum(b**2 - a * (4 - 0.4**2), 0))) / a) ** 2
        lamps, modes = len(scene.directions), len(scene.priors[0].modes)
        own = np.zeros((len(scene.materials), lamps, 3))
        lit = ball.lamps.sum(axis=3)[:, ball.inside].T > 0
        state = State(
            scene.grid.at(h),
            np.zeros((lamps, modes)),
            own,
            np.zeros((scene.segment_count, 3)),
            lit,
        )
        return with_even_albedo(scene, state)

    return build
