"""Enlarges what is known of the blocks of a photograph to its pixels; compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32
from pipeline.compiling import exact


def enlarge(blocks: Floats32, side: int, rows: slice, enlarged: Floats32) -> None:
    """Write some rows of planes of the full-size picture, bilinear between the blocks' middles.

    Parameters
    ----------
    blocks : (h, w, P), of blocks of `side` pixels from the upper left corner on
    rows : which; beyond the middles of the last blocks a plane stays as it is there
    enlarged : (P, len(rows), W), written
    """
    height, width, _ = blocks.shape
    x, right = _between(0, enlarged.shape[2], side, width)
    y, lower = _between(rows.start, rows.stop, side, height)
    _enlarge(blocks, x, right, y, lower, enlarged)


def _between(start: int, stop: int, side: int, blocks: int) -> tuple[NDArray[np.int64], Floats32]:
    """First of the two blocks beside each pixel start…stop of an axis, the second's weight."""
    place = (np.arange(start, stop) + 0.5) / side - 0.5
    first = np.clip(np.floor(place), 0, max(blocks - 2, 0))
    return first.astype(np.int64), np.clip(place - first, 0.0, 1.0).astype(np.float32)


@exact
def _enlarge(
    blocks: Floats32,
    x: NDArray[np.int64],
    right: Floats32,
    y: NDArray[np.int64],
    lower: Floats32,
    enlarged: Floats32,
) -> None:
    one = np.float32(1.0)
    height, _, planes = blocks.shape
    above, below = np.empty(len(x), np.float32), np.empty(len(x), np.float32)
    for p in range(planes):
        known = -1
        for i in range(len(y)):
            if y[i] != known:  # many rows lie between the same blocks
                known = y[i]
                _widen(blocks[known, :, p], x, right, above)
                _widen(blocks[min(known + 1, height - 1), :, p], x, right, below)
            written = enlarged[p, i]
            for j in range(len(x)):
                written[j] = (one - lower[i]) * above[j] + lower[i] * below[j]


@exact
def _widen(blocks: Floats32, x: NDArray[np.int64], right: Floats32, row: Floats32) -> None:
    for j in range(len(x)):
        second = blocks[min(x[j] + 1, len(blocks) - 1)]
        row[j] = (np.float32(1.0) - right[j]) * blocks[x[j]] + right[j] * second
