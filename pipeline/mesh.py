"""A surface as triangles, from its depth and normals."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Image
from pipeline.vectors import unit

_MOST_VERTICES = 250_000
_KNOWN = 0.5  # share of a block in which depth and normals are known
_STEEP, _SHEER = 2.0, 12.0  # depth by width of a side that may be a jump, and that is one
_OFF_SURFACE = 0.5  # sine of the angle between a jump and the surface on one of its sides


@dataclass(frozen=True)
class Mesh:
    """Triangles that face the camera, which is in the origin: x right, y up, z to the viewer.

    vertices: (v, 3), depth as given. normals: (v, 3) unit. uv: (v, 2) place in the picture, 0…1
    from its left and upper edge. faces: (t, 3) vertices, counter-clockwise seen from the camera.
    """

    vertices: NDArray[np.float64]
    normals: NDArray[np.float64]
    uv: NDArray[np.float64]
    faces: NDArray[np.int64]


def make_mesh(
    depth: NDArray[np.float32], normals: Image, focal_px: float, most: int = _MOST_VERTICES
) -> Mesh:
    """Join block means of a depth map by triangles, but for jumps and what is not known.

    depth: (H, W) along the axis, NaN where unknown. normals: (H, W, 3) unit, NaN where unknown.
    focal_px: the axis goes through the picture's middle. most: vertices at most. The mesh of a
    surface of which nothing is known is empty.
    """
    known = np.isfinite(depth) & np.isfinite(normals).all(axis=2)
    step = max(1, int(np.ceil(np.sqrt(known.sum() / most))))
    while True:
        height, width = (side // step for side in depth.shape)
        crop = np.s_[: height * step, : width * step]
        share = _means(known[crop].astype(np.float32), width, height)
        use = share >= _KNOWN
        if use.sum() <= most:
            break
        step += 1
    weight = np.where(use, share, 1.0)
    z = _means(np.where(known, depth, 0)[crop], width, height) / weight
    field = np.where(known[..., None], normals, 0)[crop]
    mean = unit(_means(field, width, height))
    row, column = (np.mgrid[:height, :width] + 0.5) * step
    x = (column - depth.shape[1] / 2) / focal_px
    y = -(row - depth.shape[0] / 2) / focal_px
    places = np.stack([x * z, y * z, -z], axis=2)
    faces = _faces(places, mean, use)
    used, index = np.unique(faces, return_inverse=True)
    uv = np.stack([column / depth.shape[1], row / depth.shape[0]], axis=2)
    return Mesh(
        places.reshape(-1, 3)[used],
        mean.reshape(-1, 3)[used],
        uv.reshape(-1, 2)[used],
        index.reshape(-1, 3),
    )


def _means(picture: NDArray[np.floating], width: int, height: int) -> NDArray[np.float64]:
    size = (width, height)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.float64)


def _faces(
    places: NDArray[np.float64], normals: NDArray[np.float64], use: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Two triangles (t, 3) for each square of known neighbours that no jump parts."""
    across = _joined(places, normals, use, np.s_[:, :-1], np.s_[:, 1:])
    down = _joined(places, normals, use, np.s_[:-1], np.s_[1:])
    square = across[:-1] & across[1:] & down[:, :-1] & down[:, 1:]
    index = np.arange(use.size).reshape(use.shape)
    a, b = index[:-1, :-1][square], index[:-1, 1:][square]
    c, d = index[1:, :-1][square], index[1:, 1:][square]
    return np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])


def _joined(
    places: NDArray[np.float64],
    normals: NDArray[np.float64],
    use: NDArray[np.bool_],
    one: tuple[slice, ...] | slice,
    other: tuple[slice, ...] | slice,
) -> NDArray[np.bool_]:
    """Whether neighbours lie on one surface: the way between them goes along it."""
    way = places[other] - places[one]
    depth, across = np.abs(way[..., 2]), np.hypot(way[..., 0], way[..., 1])
    along = unit(way)
    off = np.maximum(
        np.abs((along * normals[one]).sum(axis=2)), np.abs((along * normals[other]).sum(axis=2))
    )
    jump = (depth > _SHEER * across) | ((depth > _STEEP * across) & (off > _OFF_SURFACE))
    return np.asarray(use[one] & use[other] & ~jump)
