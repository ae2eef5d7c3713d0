"""Vectors: of length one, the angles between them, the area they span."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats, Floats64


def unit(vectors: Floats) -> Floats64:
    """Scale vectors (..., C) to length one; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0, length, 1.0), dtype=np.float64)


def angles_deg(cosines: ArrayLike) -> Floats64:
    """Angles (...), 0 to 180 degrees, of cosines (...), which rounding may take beyond ±1."""
    return np.asarray(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))))


def cross_2d(a: Floats64, b: Floats64) -> Floats64:
    """Signed areas (n,) that pairs of vectors in the plane, (n, 2) each, span."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
