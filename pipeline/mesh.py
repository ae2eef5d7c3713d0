"""A surface as triangles, from its depth and normals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.coded_normals import CodedNormals
from pipeline.frames import Image
from pipeline.strips import strips
from pipeline.vectors import unit

_MOST_VERTICES = 250_000
_KNOWN = 0.5  # share of a block in which depth and normals are known
_STEEP, _SHEER = 2.0, 12.0  # depth by width of a side that may be a jump, and that is one
_ROWS = 256  # looked at together: copies of whole pictures would take gigabytes
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
    depth: NDArray[np.float32],
    normals: Image | CodedNormals,
    focal_px: float,
    most: int = _MOST_VERTICES,
) -> Mesh:
    """Join block means of a depth map by triangles, but for jumps and what is not known.

    depth: (H, W) along the axis, NaN where unknown. normals: (H, W, 3) unit, NaN where unknown.
    focal_px: the axis goes through the picture's middle. most: vertices at most. The mesh of a
    surface of which nothing is known is empty.
    """
    known = np.empty(depth.shape, bool)
    for rows in strips(len(depth), _ROWS):
        known[rows] = np.isfinite(depth[rows]) & np.isfinite(normals[rows]).all(axis=2)
    step = max(1, int(np.ceil(np.sqrt(known.sum() / most))))
    while True:
        height, width = (side // step for side in depth.shape)
        share = _means(lambda rows: known[rows].astype(np.float32), (height, width), step)
        use = share >= _KNOWN
        if use.sum() <= most:
            break
        step += 1
    weight = np.where(use, share, 1.0)
    z = _means(lambda rows: np.where(known[rows], depth[rows], 0), (height, width), step) / weight
    mean = unit(
        _means(
            lambda rows: np.where(known[rows][..., None], normals[rows], 0), (height, width), step
        )
    )
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


def _means(
    picture: Callable[[slice], NDArray[np.floating]], shape: tuple[int, int], step: int
) -> NDArray[np.float64]:
    """Means (h, w) or (h, w, C) of blocks of step × step pixels, some rows at a time.

    picture: its rows, of which those beyond the blocks are left out. shape: (h, w).
    """
    height, width = shape
    means = [
        cv2.resize(
            np.ascontiguousarray(picture(slice(rows.start * step, rows.stop * step)))[
                :, : width * step
            ],
            (width, rows.stop - rows.start),
            interpolation=cv2.INTER_AREA,
        )
        for rows in strips(height, max(1, _ROWS // step))
    ]
    return np.concatenate(means, dtype=np.float64)


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
