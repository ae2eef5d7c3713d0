"""Triangle meshes of shapes that Mitsuba does not have: bodies of revolution."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64

_AROUND = 192  # fine enough that the rim of an attached shadow is smooth
_ALONG = 128


@dataclass(frozen=True)
class MeshData:
    """points, normals: (n, 3). uv: (n, 2). faces: (m, 3)."""

    points: Floats64
    normals: Floats64
    uv: Floats64
    faces: NDArray[np.uint32]


def mesh_of(kind: str, seed: int) -> MeshData:
    """Mesh of a kind that fits a cube of side 2 about the origin. seed: of a vase."""
    t = np.linspace(0, 1, _ALONG + 1)
    if kind == "ellipsoid":
        return _revolve([np.stack([np.sin(np.pi * t), -np.cos(np.pi * t)], 1)])
    if kind == "torus":
        angle = 2 * np.pi * t
        return _revolve([np.stack([0.7 + 0.3 * np.cos(angle), 0.3 * np.sin(angle)], 1)])
    if kind == "vase":
        return _revolve([_vase(t, np.random.default_rng(seed))])
    wide, narrow = (1.0, 1.0) if kind == "cylinder" else (1.0, 0.0)
    corners = [(0.0, -1.0), (wide, -1.0), (narrow, 1.0), (0.0, 1.0)]
    pieces = pairwise(corners)
    return _revolve([np.array(piece) for piece in pieces if piece[0] != piece[1]])


def _vase(t: Floats64, random: np.random.Generator) -> Floats64:
    swell = 0.55 + 0.2 * np.cos(2 * np.pi * (t * random.uniform(0.7, 1.3) + random.uniform()))
    closed = np.sqrt(1 - np.abs(2 * t - 1) ** 8)
    radius = swell * closed
    return np.stack([radius / radius.max() * 0.8, 2 * t - 1], 1)


def _revolve(pieces: list[Floats64]) -> MeshData:
    """Turn pieces of a profile, (n, 2) of radius and height, about y; edges between them are sharp.

    A piece goes upwards on the outside, so that its normals, to its right, look outwards.
    """
    angle = np.linspace(0, -2 * np.pi, _AROUND + 1)  # so that triangles face outwards
    parts: list[MeshData] = []
    for piece in pieces:
        along = np.gradient(piece, axis=0)
        out = np.stack([along[:, 1], -along[:, 0]], 1)
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        points = np.stack([_around(piece, angle, np.cos), _level(piece), _around(piece, angle)], 2)
        normals = np.stack([_around(out, angle, np.cos), _level(out), _around(out, angle)], 2)
        v = np.linspace(0, 1, len(piece))
        uv = np.stack(np.broadcast_arrays(-angle / (2 * np.pi), v[:, None]), 2)
        parts.append(_sheet(points, normals, uv))
    return _joined(parts)


def _around(profile: Floats64, angle: Floats64, wave: np.ufunc = np.sin) -> Floats64:
    return np.asarray(profile[:, :1] * wave(angle))


def _level(profile: Floats64) -> Floats64:
    return np.repeat(profile[:, 1:], _AROUND + 1, axis=1)


def _sheet(points: Floats64, normals: Floats64, uv: Floats64) -> MeshData:
    """Triangles between neighbours of a grid (h, w, …)."""
    height, width = points.shape[:2]
    index = np.arange(height * width, dtype=np.uint32).reshape(height, width)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)], -2)
    return MeshData(
        points.reshape(-1, 3), normals.reshape(-1, 3), uv.reshape(-1, 2), faces.reshape(-1, 3)
    )


def _joined(parts: list[MeshData]) -> MeshData:
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    return MeshData(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.uv for part in parts]),
        np.concatenate([p.faces + np.uint32(s) for p, s in zip(parts, starts, strict=False)]),
    )
