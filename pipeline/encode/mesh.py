"""A surface as triangles, from its depth and normals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.encode.coded_normals import CodedNormals
from pipeline.images.frames import Image
from pipeline.images.strips import strips
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

    vertices: Floats64
    normals: Floats64
    uv: Floats64
    faces: NDArray[np.int64]


def make_mesh(
    depth: Floats32,
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
    while len((blocks := _known_blocks(known, step))[0]) > most:
        step += 1
    number, share = blocks
    means = _means(depth, normals, known, number, step)
    z, normal = means[:, 0] / share, unit(means[:, 1:])
    width = depth.shape[1] // step
    row, column = (np.stack(np.divmod(number, width)) + 0.5) * step
    x = (column - depth.shape[1] / 2) / focal_px
    y = -(row - depth.shape[0] / 2) / focal_px
    places = np.stack([x * z, y * z, -z], axis=1)
    used, index = np.unique(_faces(places, normal, number, width), return_inverse=True)
    uv = np.stack([column / depth.shape[1], row / depth.shape[0]], axis=1)
    return Mesh(places[used], normal[used], uv[used], index.reshape(-1, 3))


def _known_blocks(known: NDArray[np.bool_], step: int) -> tuple[NDArray[np.int64], Floats64]:
    """Blocks that are known (b,), numbered row by row, and which share of each is."""
    numbers, shares = [], []
    for first, rows in _block_rows(known.shape, step):
        share = _shrunk(known[rows].astype(np.float32), step).reshape(-1)
        inside = np.flatnonzero(share >= _KNOWN)
        numbers.append(first + inside)
        shares.append(share[inside])
    return np.concatenate(numbers), np.concatenate(shares, dtype=np.float64)


def _means(
    depth: Floats32,
    normals: Image | CodedNormals,
    known: NDArray[np.bool_],
    number: NDArray[np.int64],
    step: int,
) -> Floats64:
    """Means (b, 4) of depth and normals in blocks of these numbers, what is not known as 0."""
    means = np.empty((len(number), 4))
    for first, rows in _block_rows(known.shape, step):
        values = np.dstack([depth[rows], normals[rows]])
        values[~known[rows]] = 0
        shrunk = _shrunk(values, step).reshape(-1, 4)
        here = slice(*np.searchsorted(number, (first, first + len(shrunk))))
        means[here] = shrunk[number[here] - first]
    return means


def _block_rows(shape: tuple[int, ...], step: int) -> Iterator[tuple[int, slice]]:
    """Rows of pixels that are looked at together, and the number of their first block.

    Those beyond the last whole block are left out.
    """
    for rows in strips(shape[0] // step, max(1, _ROWS // step)):
        yield rows.start * (shape[1] // step), slice(rows.start * step, rows.stop * step)


def _shrunk(rows: Floats32, step: int) -> Floats32:
    """Means of blocks of step × step pixels."""
    height, width = (side // step for side in rows.shape[:2])
    whole = np.ascontiguousarray(rows[:, : width * step])
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))


def _faces(
    places: Floats64,
    normals: Floats64,
    number: NDArray[np.int64],
    width: int,
) -> NDArray[np.int64]:
    """Two triangles (t, 3) for each square of known neighbours that no jump parts.

    number: of the blocks (b,), ascending. width: blocks in a row.
    """
    a = np.flatnonzero(number % width < width - 1)
    corners = np.stack([a] + [_at(number, number[a] + away) for away in (1, width, width + 1)])
    a, b, c, d = corners[:, (corners >= 0).all(axis=0)]
    sides = ((a, b), (c, d), (a, c), (b, d))
    square = np.logical_and.reduce([_joined(places, normals, *side) for side in sides])
    a, b, c, d = a[square], b[square], c[square], d[square]
    return np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])


def _at(number: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where blocks lie among those of these numbers, ascending; -1 for those that do not."""
    at = np.searchsorted(number, wanted)
    at[at == len(number)] = -1
    at[number[at] != wanted] = -1
    return at


def _joined(
    places: Floats64,
    normals: Floats64,
    one: NDArray[np.int64],
    other: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Whether neighbours lie on one surface: the way between them goes along it."""
    way = places[other] - places[one]
    depth, across = np.abs(way[:, 2]), np.hypot(way[:, 0], way[:, 1])
    along = unit(way)
    off = np.maximum(
        np.abs((along * normals[one]).sum(axis=1)), np.abs((along * normals[other]).sum(axis=1))
    )
    jump = (depth > _SHEER * across) | ((depth > _STEEP * across) & (off > _OFF_SURFACE))
    return np.asarray(~jump)
