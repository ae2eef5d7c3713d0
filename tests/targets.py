"""Photographs of a ColorChecker and of a sphere, drawn by formula."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
import tifffile

from pipeline.arrays import Floats64
from pipeline.spectra.colour_science import colour_science
from pipeline.spectra.wavelengths import on_grid

SIZE = (360, 240)
CORNERS = ((62.0, 58.0), (291.0, 49.0), (300.0, 188.0), (70.0, 182.0))
_FULL_WELL, _READ_NOISE, _WHITE = 20_000.0, 5.0, 0.9
_SUB = 3  # sub-pixels per side
_PATCH = 0.43  # half a side, by the distance of two patches
_FRAME = 0.9  # black cardboard beyond the outer patches' middles


def other_colorchecker() -> Floats64:
    """Reflectances (24, W) of a ColorChecker of another make than the product's (N. Ohta)."""
    patches = colour_science().SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()
    return np.array([on_grid(patch.wavelengths, patch.values, "hold") for patch in patches])


@dataclass(frozen=True)
class Shot:
    """frames: (no flash, flash), (H, W, 3) linear, 1.0 = white. files: the same as TIFF."""

    frames: tuple[Floats64, Floats64]
    files: tuple[bytes, bytes]


def photograph_chart(
    sensitivities: Floats64,
    flash: Floats64,
    lamp: Floats64,
    reflectances: Floats64,
    noise: float = 0.0,
    order: tuple[int, ...] = tuple(range(24)),
    seed: int = 0,
) -> Shot:
    """Photograph a chart whose outer patches have their middles at CORNERS.

    sensitivities: (3, W). flash, lamp: (W,). reflectances: (24, W). noise: 1 as of a sensor of
    20,000 electrons, 2 as of one of a quarter of that. order: the patch at each place. The flash
    falls off by a quarter towards the right and lower edges.
    """
    y, x = (np.mgrid[: SIZE[1] * _SUB, : SIZE[0] * _SUB] + 0.5) / _SUB
    across, down = _on_chart(x, y)
    column, row = np.round(across), np.round(down)
    inside = (np.abs(across - column) < _PATCH) & (np.abs(down - row) < _PATCH)
    inside &= (column >= 0) & (column <= 5) & (row >= 0) & (row <= 3)
    board = (across > -_FRAME) & (across < 5 + _FRAME) & (down > -_FRAME) & (down < 3 + _FRAME)
    palette = np.vstack([reflectances[list(order)], np.full((2, reflectances.shape[1]), 0.2)])
    palette[24] = 0.04
    what = np.where(inside, row * 6 + column, np.where(board, 24, 25)).astype(np.intp)
    far = np.hypot(x - 0.35 * SIZE[0], y - 0.4 * SIZE[1]) / SIZE[0]
    by_flash = (palette @ (sensitivities * flash).T)[what] / (1 + far**2)[..., None]
    by_lamp = (palette @ (sensitivities * lamp).T)[what] * (0.7 + 0.3 * x / SIZE[0])[..., None]
    by_lamp *= 0.4 * by_flash.mean() / by_lamp.mean()
    return _shot(_reduced(by_lamp), _reduced(by_flash), noise, seed)


def _on_chart(x: Floats64, y: Floats64) -> tuple[Floats64, Floats64]:
    """Columns and rows of the chart at places of the picture, by the homography of CORNERS."""
    grid = ((0.0, 0.0), (5.0, 0.0), (5.0, 3.0), (0.0, 3.0))
    rows, wanted = [], []
    for (u, v), (a, b) in zip(CORNERS, grid, strict=True):
        rows += [[u, v, 1, 0, 0, 0, -a * u, -a * v], [0, 0, 0, u, v, 1, -b * u, -b * v]]
        wanted += [a, b]
    h = np.append(np.linalg.solve(np.array(rows), np.array(wanted)), 1.0).reshape(3, 3)
    a, b, w = np.tensordot(h, np.stack([x, y, np.ones_like(x)]), axes=1)
    return a / w, b / w


FOCAL_PX = 450.0
CIRCLE = {"x": 196.0, "y": 112.0, "radius": 62.0}


def photograph_sphere(
    directions: Floats64,
    colours: Floats64,
    noise: float = 0.0,
    flash_at: tuple[float, float] = (0.0, 0.0),
    paint: float = 0.0,
    seed: int = 0,
) -> Shot:
    """Photograph a matt grey sphere whose outline is nearly CIRCLE, before a dark wall.

    directions: (N, 3) to distant lamps. colours: (N, 3) of a white card that faces them, by that
    of the flash. flash_at: of the flash in the plane of the lens, by the sphere's distance. paint:
    relative spread of its brightness from spot to spot. noise: as for photograph_chart.
    """
    random = np.random.default_rng(seed)
    width, height = SIZE
    y, x = (np.mgrid[: height * _SUB, : width * _SUB] + 0.5) / _SUB
    rays = np.stack(
        [(x - width / 2) / FOCAL_PX, (height / 2 - y) / FOCAL_PX, -np.ones_like(x)], axis=-1
    )
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    cx, cy = (CIRCLE["x"] - width / 2) / FOCAL_PX, (height / 2 - CIRCLE["y"]) / FOCAL_PX
    centre = np.array([cx, cy, -1.0]) / np.hypot(np.hypot(cx, cy), 1.0)
    radius = np.sin(np.arctan(CIRCLE["radius"] / FOCAL_PX)) * -centre[2]
    along = rays @ centre
    under_root = radius**2 - 1 + along**2
    hit = under_root > 0
    places = rays[hit] * (along[hit] - np.sqrt(under_root[hit]))[:, None]
    normals = (places - centre) / radius
    to_flash = np.array([*flash_at, 0.0]) - places
    distance = np.linalg.norm(to_flash, axis=1)
    albedo = 1 + paint * random.standard_normal(len(places))
    lit = np.full((*x.shape, 3), 0.03)
    lit[hit] = np.maximum(normals @ np.asarray(directions).T, 0) @ np.asarray(colours)
    by_flash = np.full((*x.shape, 3), 0.03)
    by_flash[hit] = (np.maximum((normals * to_flash).sum(1), 0) / distance**3)[:, None]
    lit[hit] *= albedo[:, None]
    by_flash[hit] *= albedo[:, None]
    return _shot(_reduced(lit), _reduced(by_flash * [0.8, 1.0, 0.6]), noise, seed)


def _reduced(picture: Floats64) -> Floats64:
    height, width = picture.shape[0] // _SUB, picture.shape[1] // _SUB
    return np.asarray(picture.reshape(height, _SUB, width, _SUB, 3).mean(axis=(1, 3)))


def _shot(lamps: Floats64, flash: Floats64, noise: float, seed: int) -> Shot:
    scale = _WHITE / (lamps + flash).max()
    frames = (lamps * scale, (lamps + flash) * scale)
    if noise:
        random = np.random.default_rng([seed, 1])
        well = _FULL_WELL / noise**2
        electrons = [
            random.poisson(f * well) + _READ_NOISE * random.standard_normal(f.shape) for f in frames
        ]
        frames = (electrons[0] / well, electrons[1] / well)
    return Shot(frames, (_file(frames[0], noise > 0), _file(frames[1], noise > 0)))


def _file(values: Floats64, sensor: bool) -> bytes:
    data = np.round(np.clip(values, 0, 1) * 65535).astype(np.uint16) if sensor else values
    file = io.BytesIO()
    kind = data.dtype if sensor else np.float32
    tifffile.imwrite(file, data.astype(kind), photometric="rgb", metadata=None)
    return file.getvalue()
