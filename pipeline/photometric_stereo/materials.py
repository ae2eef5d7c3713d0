"""Surfaces of one kind, told by their chromaticity under the flash."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64

_SHIFTS = 5  # of the mean to where most colours are
_FEWEST = 15  # pixels of a material
_MOST = 60  # materials
_NEAREST = 3  # materials that a pixel may be of
_SMALLEST_SEGMENT = 12  # pixels


@dataclass(frozen=True)
class Materials:
    """Centres (m, 2) of the materials' chromaticities (R, G) ÷ (R + G + B), and their radius."""

    centres: Floats64
    radius: float

    def __len__(self) -> int:
        return len(self.centres)

    def shares(self, chromaticity: Floats64) -> tuple[NDArray[np.intp], Floats64]:
        """The nearest materials (n, k) of chromaticities (n, 2), and weights that add up to 1."""
        squared = ((chromaticity[:, None] - self.centres[None]) ** 2).sum(axis=2)
        nearest = np.argsort(squared, axis=1, kind="stable")[:, :_NEAREST]
        near = np.take_along_axis(squared, nearest, axis=1)
        weights = np.exp(-(near - near[:, :1]) / (2 * (self.radius / 2) ** 2))
        return nearest, weights / weights.sum(axis=1, keepdims=True)


def find_materials(chromaticity: Floats64, radius: float) -> Materials:
    """Find clusters of chromaticities (n, 2), the densest first, by mean shift."""
    left = chromaticity
    centres: list[Floats64] = []
    while len(left) and len(centres) < _MOST:
        cells = np.floor(left / radius).astype(np.int64)
        _, first, counts = np.unique(cells, axis=0, return_index=True, return_counts=True)
        centre = left[first[np.argmax(counts)]]
        for _ in range(_SHIFTS):
            near = np.linalg.norm(left - centre, axis=1) < radius
            centre = left[near].mean(axis=0) if near.any() else centre
        near = np.linalg.norm(left - centre, axis=1) < radius
        if near.sum() < _FEWEST and centres:
            break
        centres.append(centre)
        left = left[~near]
    return Materials(np.array(centres).reshape(-1, 2), radius)


def find_segments(labels: NDArray[np.intp], mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Number the connected areas of one material; −1 in small ones.

    labels: (n,), of the pixels of the mask (H, W).
    """
    picture = np.full(mask.shape, -1)
    picture[mask] = labels
    segments = np.full(mask.shape, -1)
    count = 0
    for label in np.unique(labels):
        _, parts, stats, _ = cv2.connectedComponentsWithStats(
            (picture == label).astype(np.uint8), connectivity=4
        )
        for part in np.flatnonzero(stats[1:, cv2.CC_STAT_AREA] >= _SMALLEST_SEGMENT) + 1:
            segments[parts == part] = count
            count += 1
    return segments[mask]
