"""Estimating the lamps from the set of invariants.

Source: Hui et al. 2018, supplement, Algorithms 1 (two lamps) and 2 (three lamps).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.hui2018.projection import from_plane, to_plane
from pipeline.vectors import unit

__all__ = ["from_plane", "one_lamp", "prune", "three_lamps", "to_plane", "two_lamps", "unit"]

Array = NDArray[np.float64]

_BIN_DEGREES = 1.0
_RANSAC_TRIALS = 400
_MIN_POLE_COMPONENT = 0.1  # points nearer to the equator than this project towards infinity
_MAX_CONE = np.cos(np.radians(75.0))
_GRID = 1e-4  # of the tangent plane, 0.006°


def prune(gammas: Array, fraction: float) -> Array:
    """Drop the points in the sparsest bins of the histogram on the sphere (step 1).

    Parameters
    ----------
    gammas : (n, 3) unit vectors
    fraction : 0…1, share of the points to drop at most

    Returns
    -------
    (m, 3), (1 − fraction)·n ≤ m ≤ n
    """
    pole = np.median(gammas, axis=0)
    gammas = gammas[unit(gammas) @ unit(pole) > _MIN_POLE_COMPONENT]
    plane, _ = to_plane(gammas, pole)
    step = np.radians(_BIN_DEGREES)
    _, bins, counts = np.unique(
        np.floor(plane / step).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    by_density = np.argsort(counts, kind="stable")
    dropped = by_density[np.cumsum(counts[by_density]) <= fraction * len(plane)]
    return np.asarray(gammas[~np.isin(bins.ravel(), dropped)])


def one_lamp(gammas: Array) -> Array:
    """One lamp: the median direction of the invariants. (n, 3) → (1, 3)."""
    return unit(np.median(gammas, axis=0))[None]


def two_lamps(gammas: Array, tolerance: float, tail: float) -> Array:
    """Algorithm 1: the end points of the arc the invariants lie on.

    Parameters
    ----------
    gammas : (n, 3) pruned invariants
    tolerance : distance from the line in the tangent plane that counts as an inlier
    tail : 0…0.5, share of the inliers beyond each end point (0: the outermost points)

    Returns
    -------
    (2, 3) unit vectors
    """
    points, rotation = to_plane(gammas, np.median(gammas, axis=0))
    origin, direction, inliers = _ransac_line(points, tolerance)
    along = (points[inliers] - origin) @ direction
    ends = np.quantile(along, [tail, 1.0 - tail])
    return from_plane(origin + ends[:, None] * direction, rotation)


def three_lamps(gammas: Array) -> Array:
    """Algorithm 2: the corners of the smallest triangle around the invariants.

    (n, 3) pruned invariants → (3, 3) unit vectors. Minimum enclosing triangle: Pârvu & Gilbert.
    """
    points, rotation = to_plane(gammas, gammas.mean(axis=0))
    # OpenCV breaks on corners nearer than 1e-5, so they are put on a grid of whole numbers,
    # and it finds no hull where 0 and −0 are the only ones, so −0 becomes 0
    hull = cv2.convexHull((np.round(points / _GRID) + 0.0).astype(np.float32))
    if len(hull) < 3:
        return from_plane(np.repeat(points[:1], 3, axis=0), rotation)
    _, triangle = cv2.minEnclosingTriangle(hull)
    if triangle is None:
        return from_plane(np.repeat(points[:1], 3, axis=0), rotation)
    return from_plane(_within_cone(_GRID * triangle.reshape(3, 2).astype(np.float64)), rotation)


def _within_cone(points: Array) -> Array:
    """Pull corners back that lie so far out that no light could be there."""
    far = np.sqrt(1.0 / _MAX_CONE**2 - 1.0)
    length = np.linalg.norm(points, axis=1, keepdims=True)
    return np.asarray(points * np.minimum(1.0, far / np.maximum(length, 1e-12)))


def _ransac_line(points: Array, tolerance: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Line with most inliers, refined by total least squares: origin, unit direction, inliers."""
    rng = np.random.default_rng(0)
    pairs = rng.integers(0, len(points), (_RANSAC_TRIALS, 2))
    starts, spans = points[pairs[:, 0]], points[pairs[:, 1]] - points[pairs[:, 0]]
    lengths = np.linalg.norm(spans, axis=1)
    best = np.zeros(len(points), dtype=bool)
    for start, span, length in zip(starts, spans, lengths, strict=True):
        if length == 0:
            continue
        normal = np.array([-span[1], span[0]]) / length
        inliers = np.abs((points - start) @ normal) <= tolerance
        if inliers.sum() > best.sum():
            best = inliers
    if not best.any():
        best[:] = True
    for _ in range(2):
        origin = points[best].mean(axis=0)
        direction = np.linalg.svd(points[best] - origin, full_matrices=False)[2][0]
        normal = np.array([-direction[1], direction[0]])
        best = np.abs((points - origin) @ normal) <= tolerance
    return origin, direction, best
