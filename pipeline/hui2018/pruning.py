"""Pruning of the invariants by their histogram on the sphere.

Source: Hui et al. 2018, supplement, step 1 of Algorithms 1 and 2: G ← G(H > T).
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.hui2018.projection import rotate_to_pole

_BINS = 200
"""Bins from −1 to 1 in x and in y, each 0.57° wide at the pole: those of the authors' program."""


def prune(gammas: Floats64) -> Floats64:
    """Keep the invariants in bins that hold more than T of them (step 1).

    The source names the cutoff T and gives no value. Here T is the mean count over all the bins
    of the histogram, empty ones too, and at least 1: so a bin with a single invariant never
    stays, and the share that goes hardly depends on the size of the photograph. The authors'
    program cuts at that mean for two lights and at 1 for three.

    Parameters
    ----------
    gammas : (n, 3) unit vectors; the histogram is of x and y with their mean at the north pole

    Returns
    -------
    (m, 3), m ≤ n, in their order; those behind the pole are gone, having no place in the plane
    """
    if not len(gammas):
        return gammas
    rotated = gammas @ rotate_to_pole(gammas.mean(axis=0)).T
    front = rotated[:, 2] > 0
    cells = np.minimum((rotated[front, :2] + 1.0) * (_BINS / 2), _BINS - 1).astype(np.int64)
    bins = cells[:, 0] * _BINS + cells[:, 1]
    histogram = np.bincount(bins, minlength=_BINS**2)
    cutoff = max(1.0, float(histogram.mean()))
    return np.asarray(gammas[front][histogram[bins] > cutoff])
