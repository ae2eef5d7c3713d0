"""Where the fit starts: colours that stand out on the sphere of invariants."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import Floats64
from pipeline.errors import UnusablePairError
from pipeline.hui2018.invariant import light_coefficients
from pipeline.hui2018.lights import NO_AGREEMENT
from pipeline.hui2018.projection import from_plane, to_plane
from pipeline.matrixfit.chromaticities import Chromaticities
from pipeline.matrixfit.evidence import Evidence
from pipeline.vectors import unit

# Chosen on development scenes (docs/decisions/0005-fitted-lamps.md)
_BINS, _BLUR = 96, 1.2  # of a histogram: to a side; standard deviation in bins
_PEAKS_OF_DIFFERENCES, _PEAKS_OF_PIXELS = 14, 8
_EXTREMES = (0.005, 0.03)  # shares of the points, the outermost in a direction
_DIRECTIONS = 12
_SAME_DEGREES = 1.5
_MOST_CANDIDATES = 30


def invariants(data: Chromaticities, tensor: Floats64) -> Floats64:
    """Unit Γ (n, 3) of data, those that the model cannot solve left out."""
    gammas = unit(light_coefficients(data.light, data.x, tensor))
    return np.asarray(gammas[gammas.any(axis=1)])


def start_points(evidence: Evidence, tensor: Floats64) -> Floats64:
    """Coefficients (k, 3) of lights that may be lamps; at most thirty.

    Raises UnusablePairError where the model makes no sense of any pixel, as under a wrong camera.
    """
    pixels = invariants(evidence.pixels, tensor)
    if not len(pixels):
        raise UnusablePairError(NO_AGREEMENT)
    center = unit(np.median(pixels, axis=0))
    plane, rotation = to_plane(pixels, center)
    if not len(plane):
        raise UnusablePairError(NO_AGREEMENT)
    found: list[Floats64] = []
    for alone in (evidence.differences, evidence.terminators, evidence.pools):
        if len(alone):
            points, _ = to_plane(invariants(alone, tensor), center)
            found.append(_peaks(points, plane, _PEAKS_OF_DIFFERENCES))
    found.append(_peaks(plane, plane, _PEAKS_OF_PIXELS))
    found.append(_extremes(plane))
    return _merged(np.concatenate(found), rotation)


def _peaks(points: Floats64, frame: Floats64, count: int) -> Floats64:
    """Strongest local maxima of the blurred histogram, within the bounds of `frame`."""
    low, high = np.quantile(frame, [0.001, 0.999], axis=0)
    margin = 0.3 * (high - low).max() + 1e-3
    low, high = low - margin, high + margin
    edges = [np.linspace(low[axis], high[axis], _BINS + 1) for axis in (0, 1)]
    histogram, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=edges)
    smooth = cv2.GaussianBlur(histogram.astype(np.float32), (0, 0), _BLUR)
    top = (smooth >= cv2.dilate(smooth, np.ones((5, 5), np.uint8))) & (smooth > 0)
    where = np.argwhere(top)
    strongest = where[np.argsort(-smooth[top], kind="stable")][:count]
    size = (high - low) / _BINS
    return np.asarray(low + (strongest + 0.5) * size)


def _extremes(points: Floats64) -> Floats64:
    """Medians of the outermost points in twelve directions."""
    found = []
    for angle in np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS:
        along = points @ (np.cos(angle), np.sin(angle))
        found += [np.median(points[along >= np.quantile(along, 1 - q)], axis=0) for q in _EXTREMES]
    return np.array(found)


def _merged(points: Floats64, rotation: Floats64) -> Floats64:
    """Unit vectors of points, near ones only once, the first ones first."""
    kept: list[Floats64] = []
    for vector in from_plane(points, rotation):
        if all(vector @ other < np.cos(np.radians(_SAME_DEGREES)) for other in kept):
            kept.append(vector)
    return np.array(kept[:_MOST_CANDIDATES])
