"""Sums of what pixels have, over those around each corner and over those of each material."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from pipeline.arrays import Floats64


class Sums:
    """Sums over n pixels at c corners and over m materials."""

    def __init__(
        self,
        corners: NDArray[np.intp],
        which: NDArray[np.intp],
        share: Floats64,
        corner_count: int,
        material_count: int,
    ) -> None:
        """corners: (n, 4) of each pixel. which, share: (n, s), its materials and their weights."""
        n = len(corners)
        self._counts = corner_count, material_count
        both = corners[:, :, None] * material_count + which[:, None]
        shares = np.broadcast_to(share[:, None], both.shape)
        twice = which[:, :, None] * material_count + which[:, None]
        products = share[:, :, None] * share[:, None]
        size, s = corners.size, which.shape[1]
        self._at_corners = _summing(corners.reshape(size, 1), np.ones(size), corner_count)
        self._at_both = _summing(both.reshape(size, s), shares, corner_count * material_count)
        self._of_materials = _summing(which, share, material_count)
        self._twice = _summing(twice.reshape(n, s * s), products, material_count**2)

    def at_corners(self, values: Floats64) -> Floats64:
        """Sums (c, k) of what pixels have at their corners, (n, 4, k)."""
        return np.asarray(self._at_corners @ values.reshape(-1, values.shape[2]))

    def of_materials(self, values: Floats64) -> Floats64:
        """Sums (m, …) of what pixels have, (n, …), by the weight of the material."""
        summed = self._of_materials @ values.reshape(len(values), -1)
        return np.asarray(summed.reshape(-1, *values.shape[1:]))

    def at_corners_of_materials(self, values: Floats64) -> Floats64:
        """Sums (c, m, k) of what pixels have at their corners, (n, 4, k), by the material."""
        summed = self._at_both @ values.reshape(-1, values.shape[2])
        return np.asarray(summed.reshape(*self._counts, -1))

    def of_pairs(self, values: Floats64) -> Floats64:
        """Sums (m, m, …) of what pixels have, (n, …), by the weights of two materials."""
        summed = self._twice @ values.reshape(len(values), -1)
        return np.asarray(summed.reshape(self._counts[1], self._counts[1], *values.shape[1:]))


def _summing(places: NDArray[np.intp], weights: Floats64, count: int) -> sparse.csr_array:
    """Matrix (count, n) that sums n values into k places each, places and weights (n, k)."""
    n, k = places.shape
    starts = np.arange(0, n * k + 1, k)
    columns = (weights.ravel(), places.ravel(), starts)
    return sparse.csc_array(columns, shape=(count, n)).tocsr()
