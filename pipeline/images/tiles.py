"""Parts of a large picture that stand for the whole."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.images.coded_image import CodedImage

TILE_ROWS = 64
"""Rows of a tile: 8 of means over 8 × 8 pixels."""

_COLUMNS = 128


def tiles(picture: NDArray[Any] | CodedImage, most: int) -> NDArray[Any]:
    """Tiles of a picture (H, W, 3), evenly spread over it, one below the other.

    most: pixels in all. A picture less than a tile high gives none; one that is less than 128
    pixels wide gives tiles of its own width. Returns (h, w, 3) of the picture's type, float32
    light of a CodedImage.
    """
    width = min(_COLUMNS, picture.shape[1])
    columns = picture.shape[1] // width
    count = picture.shape[0] // TILE_ROWS * columns
    chosen = np.linspace(0, count - 1, min(most // (TILE_ROWS * width), count)).astype(int)
    corners = [(one // columns * TILE_ROWS, one % columns * width) for one in chosen]
    parts = [picture[y : y + TILE_ROWS, x : x + width] for y, x in corners]
    return np.concatenate(parts) if parts else picture[:1, :width][:0]
