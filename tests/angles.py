"""Angles between colours, spectra and directions."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats, Floats64

Vectors = Floats


def angles(one: Vectors, other: Vectors) -> Floats64:
    """Angles in degrees between vectors along the last axis, NaN where one of them is."""
    a, b = (vectors.astype(np.float64) for vectors in (one, other))
    cosine = (a * b).sum(-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
