"""Enlarges what is known of the blocks of a photograph to its pixels; compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.compiling import exact

Array = NDArray[np.float32]


def enlarge(blocks: Array, side: int, rows: slice, enlarged: Array) -> None:
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


def _between(start: int, stop: int, side: int, blocks: int) -> tuple[NDArray[np.int64], Array]:
    """First of the two blocks beside each pixel start…stop of an axis, the second's weight."""
    place = (np.arange(start, stop) + 0.5) / side - 0.5
    first = np.clip(np.floor(place), 0, max(blocks - 2, 0))
    return first.astype(np.int64), np.clip(place - first, 0.0, 1.0).astype(np.float32)


@exact
def _enlarge(
    blocks: Array,
    x: NDArray[np.int64],
    right: Array,
    y: NDArray[np.int64],
    lower: Array,
    enlarged: Array,
) -> None:
    one = np.float32(1.0)
    height, width, planes = blocks.shape
    row = np.empty(width, np.float32)
    for i in range(len(y)):
        for p in range(planes):
            top, bottom = blocks[y[i], :, p], blocks[min(y[i] + 1, height - 1), :, p]
            for c in range(width):
                row[c] = (one - lower[i]) * top[c] + lower[i] * bottom[c]
            written = enlarged[p, i]
            for j in range(len(x)):
                second = row[min(x[j] + 1, width - 1)]
                written[j] = (one - right[j]) * row[x[j]] + right[j] * second
