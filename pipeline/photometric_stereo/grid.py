"""The surface before the camera as squared depths, in which light is linear.

Axes: x right, y up, z to the viewer, the camera in the origin. A pixel's ray is d = (X, Y, −1).
With h = z² at the corners of pixels, the normal n in the length D²/(n·v), D being the distance and
v the direction to the camera, is

    w = |d|³ (f h_x/2, −f h_y/2, h + X f h_x/2 − Y f h_y/2),

rows running down. A flash at the camera gives albedo/|w|, a distant lamp l gives albedo (l·w)/|w|,
so that the light of the lamps is (l·w) times the flash part: linear in h.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.arrays import Floats64

_FAR, _BULGE = 8.0, 1.0  # of the inflated start: distance and height in radii


@dataclass(frozen=True)
class Grid:
    """The pixels of a surface, and what w is of the squared depths at their corners.

    mask: bool (H, W), n pixels. corners: (n, 4), places among the c corners. to_w: (n, 3, 4), w
    from the corners' h. bent: (b, 3), places of three corners in a row that sides of pixels join.
    corner_mask: bool (H + 1, W + 1). focal_px, centre: as of make_grid.
    """

    mask: NDArray[np.bool_]
    corners: NDArray[np.intp]
    to_w: Floats64
    bent: NDArray[np.intp]
    corner_mask: NDArray[np.bool_]
    focal_px: float
    centre: tuple[float, float]

    def without(self, off: NDArray[np.bool_]) -> Grid:
        """The grid without some of its pixels (n,)."""
        mask = self.mask.copy()
        mask[mask] = ~off
        return make_grid(mask, self.focal_px, self.centre)

    @cached_property
    def corner_count(self) -> int:
        """How many corners there are, c."""
        return int(self.corner_mask.sum())

    def w(self, h: Floats64) -> Floats64:
        """Normals (n, 3) of length D²/(n·v). h: (c,) squared depths."""
        return np.asarray(np.einsum("nck,nk->nc", self.to_w, h[self.corners]))

    @property
    def to_bend(self) -> Floats64:
        """What (3,) a bend is of the squared depths at its corners."""
        return self.focal_px / 2 * np.array([1.0, -2.0, 1.0])

    def bends(self, h: Floats64) -> Floats64:
        """Bends (b,), by how much slopes change per pixel where h is 1. h: (c,) squared depths."""
        return np.asarray(h[self.bent] @ self.to_bend)

    def flat(self) -> Floats64:
        """Squared depths (c,) of a plane that faces the camera."""
        return np.ones(self.corner_count)

    def inflated(self) -> Floats64:
        """Squared depths (c,) of the silhouette blown up like a balloon."""
        rim = np.pad(self.mask, 1)
        inside = ndimage.distance_transform_edt(rim)
        # a corner is as far inside as the pixels around it
        e = (inside[:-1, :-1] + inside[1:, :-1] + inside[:-1, 1:] + inside[1:, 1:]) / 4
        radius = e.max()
        height = np.sqrt(radius**2 - (radius - e) ** 2) / radius
        return np.asarray(((_FAR - _BULGE * height) / _FAR) ** 2)[self.corner_mask]

    def at(self, picture: Floats64) -> Floats64:
        """Values (c,) at the corners of a field over all corners (H + 1, W + 1)."""
        return np.asarray(picture[self.corner_mask])


def make_grid(mask: NDArray[np.bool_], focal_px: float, centre: tuple[float, float]) -> Grid:
    """Lay the grid. focal_px, centre (x, y): in pixels of the mask, the first at (0, 0)."""
    height, width = mask.shape
    corner_mask = np.zeros((height + 1, width + 1), dtype=bool)
    for dy in (0, 1):
        for dx in (0, 1):
            corner_mask[dy : dy + height, dx : dx + width] |= mask
    index = np.full(corner_mask.shape, -1)
    index[corner_mask] = np.arange(corner_mask.sum())
    y, x = np.nonzero(mask)
    corners = np.stack([index[y, x], index[y, x + 1], index[y + 1, x], index[y + 1, x + 1]], axis=1)
    X, Y = (x - centre[0]) / focal_px, -(y - centre[1]) / focal_px
    mean = np.full(4, 0.25)
    across = focal_px / 4 * np.array([-1.0, 1.0, -1.0, 1.0])
    down = focal_px / 4 * np.array([-1.0, -1.0, 1.0, 1.0])
    zero = np.zeros_like(X)[:, None]
    rows = [across + zero, -down + zero, mean + X[:, None] * across - Y[:, None] * down]
    to_w = np.stack(rows, axis=1) * ((1 + X**2 + Y**2) ** 1.5)[:, None, None]
    return Grid(mask, corners, to_w, _bent(index, mask), corner_mask, focal_px, centre)


def _bent(index: NDArray[np.intp], mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    rim = np.pad(mask, 1)
    # between corners that no pixel joins the surface may jump
    across, down = rim[:-1, 1:-1] | rim[1:, 1:-1], rim[1:-1, :-1] | rim[1:-1, 1:]
    triples = []
    for a, b, c, joined in (
        (index[:, :-2], index[:, 1:-1], index[:, 2:], across[:, :-1] & across[:, 1:]),
        (index[:-2], index[1:-1], index[2:], down[:-1] & down[1:]),
    ):
        triples.append(np.stack([a[joined], b[joined], c[joined]], axis=1))
    return np.concatenate(triples)


def carried(h: Floats64, old: Grid, new: Grid, scale: float = 1.0) -> Floats64:
    """Squared depths at the corners of a new grid, beyond the old one as at its nearest corner.

    h: (c,) at the corners of the old one. scale: side of the new grid's pixels in those of the old
    one.
    """
    known = old.corner_mask
    field = np.zeros(known.shape)
    field[known] = h
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    places = np.array(np.nonzero(new.corner_mask)) * scale
    return np.asarray(
        ndimage.map_coordinates(field[tuple(nearest)], places, order=1, mode="nearest")
    )
