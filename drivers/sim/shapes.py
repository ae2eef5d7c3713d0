"""Analytic shapes: where a ray enters them, and their normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.sim.scene import Shape

Array = NDArray[np.float64]


class Solid:
    """A sphere, box or cylinder: a unit shape around the origin under an affine map.

    index: its place in the scene. centre, radius: of the sphere around it, in metres.
    """

    def __init__(self, index: int, shape: Shape) -> None:
        self.index = index
        self._pattern = shape.pattern
        self._gap = shape.gap
        self.kind = shape.kind
        self.centre = np.array(shape.centre)
        half = np.array(shape.half)
        rotation = _rotation(shape.turn, shape.tilt, shape.roll)
        self._to_unit = (rotation / half).T
        reach = {"sphere": half.max(), "box": float(np.linalg.norm(half))}
        self.radius = reach.get(self.kind, float(np.hypot(max(half[0], half[2]), half[1])))

    def enter(self, origins: Array, directions: Array) -> Array:
        """Ray parameter of the entry, infinite where the ray misses; (..., n).

        origins: (n, 3) or (3,), outside the shape. directions: (..., n, 3).
        """
        o = (origins - self.centre) @ self._to_unit.T
        d = directions @ self._to_unit.T
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.kind == "sphere":
                start, end = _quadratic(o, d, (0, 1, 2))
            elif self.kind == "cylinder":
                start, end = _quadratic(o, d, (0, 2))
                low, high = _slab(o, d, 1)
                start, end = np.maximum(start, low), np.minimum(end, high)
            else:
                bounds = [_slab(o, d, axis) for axis in range(3)]
                start = np.maximum.reduce([low for low, _ in bounds])
                end = np.minimum.reduce([high for _, high in bounds])
            return np.where((start < end) & (start > 0), start, np.inf)

    def cells(self, points: Array) -> NDArray[np.intp]:
        """Count cells of the pattern row by row, (n,), for points (n, 3) on the surface."""
        if self._pattern == (1, 1):
            return np.zeros(len(points), np.intp)
        p = (points - self.centre) @ self._to_unit.T
        along = p[:, 0] if self.kind == "box" else np.arctan2(p[:, 0], p[:, 2]) / np.pi
        columns, rows = self._pattern
        column = np.clip((along + 1) / 2 * columns, 0, columns - 1).astype(np.intp)
        row = np.clip((p[:, 1] + 1) / 2 * rows, 0, rows - 1).astype(np.intp)
        cells = row * columns + column
        if self._gap:
            across, up = (along + 1) / 2 * columns % 1 - 0.5, (p[:, 1] + 1) / 2 * rows % 1 - 0.5
            between = np.maximum(np.abs(across), np.abs(up)) > (1 - self._gap) / 2
            cells = np.where(between, columns * rows, cells)
        return np.asarray(cells)

    def normals(self, points: Array) -> Array:
        """Compute outward unit normals at points on the surface, (n, 3)."""
        p = (points - self.centre) @ self._to_unit.T
        if self.kind == "cylinder":
            cap = np.abs(p[:, 1]) > np.hypot(p[:, 0], p[:, 2])
            p = np.where(cap[:, None], p * (0, 1, 0), p * (1, 0, 1))
        elif self.kind == "box":
            p = p * (np.abs(p) == np.abs(p).max(axis=1, keepdims=True))
        return _unit(p @ self._to_unit)


class Sweep:
    """A floor that curves up into a wall, seen from in front; it casts no shadow."""

    def __init__(self, index: int, shape: Shape) -> None:
        self.index = index
        self._centre = np.array(shape.centre)
        self._radius, self._depth = shape.half[1], shape.half[2]

    def enter(self, origins: Array, directions: Array) -> Array:
        """Ray parameter where the ray meets it, infinite where it goes past; (n,)."""
        o = np.broadcast_to(origins - self._centre, directions.shape)
        y, z, r = self._radius, self._radius - self._depth, self._radius
        o_curve = o - np.array((0.0, y, z))
        with np.errstate(divide="ignore", invalid="ignore"):
            floor = -o[:, 1] / directions[:, 1]
            wall = (-self._depth - o[:, 2]) / directions[:, 2]
            curve = _quadratic(o_curve / r, directions / r, (1, 2))[1]
            on_floor = (floor > 0) & (o[:, 2] + floor * directions[:, 2] >= z)
            on_wall = (wall > 0) & (o[:, 1] + wall * directions[:, 1] >= y)
        curve = np.where(np.isfinite(curve) & (curve > 0), curve, np.inf)
        return np.where(on_floor, floor, np.where(on_wall, wall, curve))

    def cells(self, points: Array) -> NDArray[np.intp]:
        """Count cells: a sweep is of one material, (n,) zeros."""
        return np.zeros(len(points), np.intp)

    def normals(self, points: Array) -> Array:
        """Compute unit normals at points on the surface, (n, 3)."""
        p = points - self._centre
        y, z = self._radius - p[:, 1], self._radius - self._depth - p[:, 2]
        zero = np.zeros_like(y)
        return _unit(np.stack([zero, np.where(z > 0, np.maximum(y, 0), 1), np.maximum(z, 0)], -1))


def build(shapes: tuple[Shape, ...]) -> list[Solid | Sweep]:
    """Build the shapes of a scene, in its order."""
    return [
        Sweep(index, shape) if shape.kind == "sweep" else Solid(index, shape)
        for index, shape in enumerate(shapes)
    ]


def _quadratic(o: Array, d: Array, axes: tuple[int, ...]) -> tuple[Array, Array]:
    """Entry and exit of the unit ball of the given axes; NaN or infinite where it is missed."""
    a = sum(d[..., axis] * d[..., axis] for axis in axes)
    b = sum(o[..., axis] * d[..., axis] for axis in axes)
    c = sum(o[..., axis] * o[..., axis] for axis in axes) - 1
    root = np.sqrt(b * b - a * c)
    along = a == 0  # the ray runs along the other axis: inside for ever, or never
    inside = np.where(c < 0, np.inf, -np.inf)
    return np.where(along, -inside, (-b - root) / a), np.where(along, inside, (-b + root) / a)


def _slab(o: Array, d: Array, axis: int) -> tuple[Array, Array]:
    """Entry and exit of -1 ≤ coordinate ≤ 1."""
    first, second = (-1 - o[..., axis]) / d[..., axis], (1 - o[..., axis]) / d[..., axis]
    return np.minimum(first, second), np.maximum(first, second)


def _rotation(turn: float, tilt: float, roll: float) -> Array:
    """Degrees about y, after x, after z."""
    (cy, cx, cz), (sy, sx, sz) = (f(np.radians((turn, tilt, roll))) for f in (np.cos, np.sin))
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_y @ about_x @ about_z)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
