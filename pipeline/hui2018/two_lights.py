"""Two lights: the end points of the arc the invariants lie on.

Source: Hui et al. 2018, supplement, Algorithm 1; RANSAC: Fischler and Bolles 1981.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.hui2018.projection import from_plane, to_plane

_TRIALS = 1000
_TOLERANCE = np.tan(np.radians(0.3))
"""Of the tangent plane. Trials and tolerance: the supplement gives none, the authors' program
these."""


def two_lights(gammas: Floats64) -> Floats64:
    """Algorithm 1 after its pruning: steps 2 to 6.

    findCenter is not defined in the source; the mean is taken, as in Algorithm 2. The end points
    are the outermost inliers of the line.

    Parameters
    ----------
    gammas : (n, 3) pruned invariants, n ≥ 1

    Returns
    -------
    (2, 3) unit vectors g_1, g_2; the same one twice where all invariants are equal
    """
    points, rotation = to_plane(gammas, gammas.mean(axis=0))
    origin, direction, inliers = _fit_line(points)
    along = (points[inliers] - origin) @ direction
    return from_plane(origin + np.outer([along.min(), along.max()], direction), rotation)


def _fit_line(points: Floats64) -> tuple[Floats64, Floats64, NDArray[np.bool_]]:
    """RANSAC (step 4): origin (2,), unit direction (2,), inliers (n,) of the line with most.

    The line through the best two points is refined by total least squares on its inliers. The
    pairs drawn are the same every time.
    """
    drawn = np.random.default_rng(0).integers(0, len(points), (_TRIALS, 2))
    starts, spans = points[drawn[:, 0]], points[drawn[:, 1]] - points[drawn[:, 0]]
    lengths = np.linalg.norm(spans, axis=1)
    best, most = np.ones(len(points), dtype=bool), 0
    for start, span, length in zip(starts, spans, lengths, strict=True):
        if length == 0:
            continue
        inliers = _near(points, start, span / length)
        count = int(np.count_nonzero(inliers))
        if count > most:
            best, most = inliers, count
    origin = points[best].mean(axis=0)
    spread = points[best] - origin
    direction = np.linalg.eigh(spread.T @ spread)[1][:, 1]
    return origin, direction, best


def _near(points: Floats64, origin: Floats64, direction: Floats64) -> NDArray[np.bool_]:
    normal = np.array([-direction[1], direction[0]])
    return np.asarray(np.abs(points @ normal - origin @ normal) <= _TOLERANCE)
