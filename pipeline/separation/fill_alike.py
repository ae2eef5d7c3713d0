"""Fills gaps from places around that look alike without the flash; compiled.

Beside a thing lies the flash's shadow, on a wall that other lamps may light than the thing. What
fills it from the nearest places alone mixes both; the photograph without the flash tells them
apart, for in the flash's shadow it is as good as elsewhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.compiling import exact
from pipeline.images.frames import Image

# Chosen on development scenes (docs/trials/sharing_out.md)
_RADII = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)  # blocks; nearer places lie denser
_DIRECTIONS = 16
_COLOUR = 0.03  # by which chromaticities of alike light differ
_BRIGHTNESS = 0.5  # the same of the logarithm of light
_ANYHOW = 1.0  # weight of the surroundings however they look, beside that of each alike place
_TINY = 1e-30


def fill_alike(
    filled: Floats32, values: Floats32, known: Floats32, light: Image, variance: Image
) -> Floats32:
    """Values (h, w, C) with gaps as at alike places, in rings around, however far they are.

    A place counts by what is known of it, and the less the more its light differs from that of the
    gap in chromaticity and brightness, beyond noise. Where there is no light to compare, and where
    nothing is alike, gaps stay as they were filled.

    Parameters
    ----------
    filled : (h, w, C), gaps filled from all surroundings
    values : (h, w, C), what is known
    known : (h, w) 0…1, how much of a place is known, 0 in gaps
    light, variance : (h, w, 3), of the photograph without the flash, ≤ 0 where there is none
    """
    total = light.sum(axis=2, dtype=np.float64)
    seen = np.maximum(total, _TINY)
    noise = np.where(total > 0, variance.sum(axis=2, dtype=np.float64) / np.square(seen), 0.0)
    rows, columns = np.nonzero((known <= 0) & (total > 0))
    found = filled.copy()
    if len(rows):
        _fill(
            rows,
            columns,
            values,
            known,
            np.ascontiguousarray(light / seen[..., None]),
            np.log(seen),
            noise,
            _offsets(),
            found,
        )
    return found


def _offsets() -> Floats64:
    """Steps (n, 2) to the places that are asked, rows and columns."""
    turns = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    rings = [np.stack([np.sin(turns), np.cos(turns)], axis=1) * radius for radius in _RADII]
    # of small rings several directions lead to one place
    return np.unique(np.rint(np.concatenate(rings)), axis=0)


@exact
def _fill(
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    values: Floats32,
    known: Floats32,
    colour: Floats64,
    level: Floats64,
    noise: Floats64,
    offsets: Floats64,
    found: Floats32,
) -> None:
    """Write found (h, w, C) at rows and columns; level: logarithm of light, noise: its variance."""
    height, width, channels = values.shape
    summed = np.empty(channels)
    for at in range(len(rows)):
        y, x = rows[at], columns[at]
        weight = _ANYHOW
        for c in range(channels):
            summed[c] = weight * found[y, x, c]
        for k in range(len(offsets)):
            v, u = y + int(offsets[k, 0]), x + int(offsets[k, 1])
            if v < 0 or v >= height or u < 0 or u >= width or known[v, u] <= 0:
                continue
            apart = 0.0
            for c in range(3):
                apart += (colour[y, x, c] - colour[v, u, c]) ** 2
            by_noise = noise[y, x] + noise[v, u]
            apart /= _COLOUR**2 + by_noise
            apart += (level[y, x] - level[v, u]) ** 2 / (_BRIGHTNESS**2 + by_noise)
            alike = known[v, u] * np.exp(-0.5 * apart)
            weight += alike
            for c in range(channels):
                summed[c] += alike * values[v, u, c]
        for c in range(channels):
            found[y, x, c] = summed[c] / weight
