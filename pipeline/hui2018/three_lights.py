"""Three lights: the corners of the smallest triangle around the invariants.

Source: Hui et al. 2018, supplement, Algorithm 2; minimum triangle: Pârvu and Gilbert 2016,
"Implementation of linear minimum area enclosing triangle algorithm", which OpenCV has.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import Floats64
from pipeline.hui2018.projection import from_plane, to_plane

_GRID = 1e-4  # of the tangent plane, 0.006°


def three_lights(gammas: Floats64) -> Floats64:
    """Algorithm 2 after its pruning: steps 2 to 5.

    Parameters
    ----------
    gammas : (n, 3) pruned invariants, n ≥ 1

    Returns
    -------
    (3, 3) unit vectors g_1, g_2, g_3. Where the invariants lie on a line, and the triangle has no
    area, its ends and the middle between them.
    """
    points, rotation = to_plane(gammas, gammas.mean(axis=0))
    return from_plane(minimum_triangle(points), rotation)


def minimum_triangle(points: Floats64) -> Floats64:
    """Corners (3, 2) of the triangle of least area around the points (n, 2), n ≥ 1 (step 4)."""
    # OpenCV breaks on corners nearer than 1e-5, so they are put on a grid of whole numbers,
    # and it finds no hull where 0 and −0 are the only ones, so −0 becomes 0
    hull = cv2.convexHull((np.round(points / _GRID) + 0.0).astype(np.float32))
    corners = cv2.minEnclosingTriangle(hull)[1] if len(hull) >= 3 else None
    if corners is not None:
        return np.asarray(_GRID * corners.reshape(3, 2), dtype=np.float64)
    ends = _GRID * hull.reshape(-1, 2)[[0, -1]].astype(np.float64)
    return np.stack([ends[0], ends.mean(axis=0), ends[1]])
