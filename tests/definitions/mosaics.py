"""What demosaicing computes, in plain NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64

OFFSET, LEAST, ALIKE = 0.003, 0.0006, 1e-4
_AROUND = 12


def demosaiced(light: Floats64, colours: NDArray[np.integer]) -> Floats64:
    """Three channels (H, W, 3) of photosites' light (H, W), white at 1, black at 0.

    colours: (2, 2), channel of the upper left photosites. _AROUND photosites are mirrored at the
    border, so that the mosaic goes on.
    """
    height, width = light.shape
    measured = np.pad(np.minimum(light, 1.0), _AROUND, mode="reflect")
    raised = np.maximum(measured + OFFSET, LEAST)
    across, down = (
        np.log2(_sum(raised, axis, {-1: 0.5, 1: 0.5}))
        - np.log2(_sum(raised, axis, {-2: 0.25, 0: 0.5, 2: 0.25}))
        for axis in (1, 0)
    )
    steep, fall = (
        _square(np.abs(_sum(ratios, axis, {1: 1, -1: -1}))) ** 2 + ALIKE
        for ratios, axis in ((across, 1), (down, 0))
    )
    share = fall / (steep + fall)
    inwards = {-1: -0.25, 0: 0.5, 1: -0.25}
    green = share * _sum(across, 1, inwards) + (1 - share) * _sum(down, 0, inwards)
    beside, beyond = {-1: 1.0, 1: 1.0}, {-3: 1.0, 3: 1.0}
    diagonal = (
        10 * _sum(_sum(green, 0, beside), 1, beside)
        - _sum(_sum(green, 0, beside), 1, beyond)
        - _sum(_sum(green, 0, beyond), 1, beside)
    ) / 32
    half = {-1: 0.5, 1: 0.5}
    channel = np.asarray(colours)[np.ix_(*(np.arange(size) % 2 for size in measured.shape))]
    found = np.empty((*measured.shape, 3))
    for one in (0, 2):
        there, opposite = channel == one, channel == 2 - one
        to_one = np.where(there, green, diagonal)  # of red and blue photosites
        of_both = share * _sum(to_one, 1, half) + (1 - share) * _sum(to_one, 0, half)
        logs = np.where(opposite, green - diagonal, -of_both)
        found[..., one] = np.where(there, measured, raised * 2**logs - OFFSET)
    found[..., 1] = np.where(channel == 1, measured, raised * 2**green - OFFSET)
    inner = found[_AROUND : _AROUND + height, _AROUND : _AROUND + width]
    return np.asarray(np.minimum(inner, 1.0))


def _sum(values: Floats64, axis: int, weights: dict[int, float]) -> Floats64:
    """Weighted sum of values so many places on; wrong at the border, which is cut off."""
    return np.asarray(sum(w * np.roll(values, -by, axis) for by, w in weights.items()))


def _square(values: Floats64) -> Floats64:
    five = dict.fromkeys(range(-2, 3), 1.0)
    return _sum(_sum(values, 0, five), 1, five)
