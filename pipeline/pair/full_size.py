"""Finds a shift by less than a pixel or two of large photographs, by tiles of their full size.

In the smaller photographs that motions are found in, it is a fraction of a pixel, which shadows
explain as well. In full size the finest texture of surfaces tells it.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Image, Photograph
from pipeline.pair.refine import (
    SHIFT,
    agreement,
    finish_motion,
    log_detail,
    products,
)

_GRID = (4, 6)  # rows and columns of places, one tile in each
_SIDE = 128  # pixels of a tile
_AGREES = 0.5  # tiles whose steps correlate less tell nothing
_FARTHEST = 2.0  # pixels; a tile that goes on has other things to lie on
_FEW = 8  # tiles that still tell
_SURE = 5.0  # standard errors
_LEAST = 0.15  # pixels; resampling the photograph costs as much
_MAD = 1.4826  # a Gaussian's standard deviation by its median absolute deviation
_OF_MEDIAN = 1.2533  # standard error of a Gaussian's median, over that of its mean


def full_size_shift(
    no_flash: Photograph, flash: Photograph, steps: tuple[Image, Image]
) -> Floats64:
    """Find the shift by which two photographs lie beside each other that seem not to have moved.

    no_flash, flash: (H, W, 3) linear. steps: of both, by log_detail, (h, w, 3) of photographs that
    may be much smaller; they say where there is something to see. Returns (x, y) in pixels, from a
    no-flash pixel to the flash pixel, less than two; 0 where the picture does not agree on any.
    """
    height, width, _ = no_flash.shape
    tiles = (_shift_of(no_flash, flash, x, y) for x, y in _places(steps, (width, height)))
    shifts = np.array([shift for shift in tiles if shift is not None])
    if len(shifts) < _FEW:
        return np.zeros(2)
    shift = np.median(shifts, axis=0)
    deviation = _MAD * np.median(np.abs(shifts - shift), axis=0)
    error = _OF_MEDIAN * deviation / np.sqrt(len(shifts))
    sure = np.hypot(*shift) >= _LEAST and (np.abs(shift) >= _SURE * error).any()
    return np.asarray(shift) if sure else np.zeros(2)


def _places(steps: tuple[Image, Image], size: tuple[int, int]) -> list[tuple[int, int]]:
    """Corners (x, y) of tiles in a picture of full (width, height): of each place what shows most.

    None where the picture is too small for a tile.
    """
    height, width = steps[0].shape[:2]
    x_scale, y_scale = size[0] / width, size[1] / height
    box = round(_SIDE / x_scale), round(_SIDE / y_scale)
    squares = (cv2.boxFilter(np.square(one).sum(axis=2), -1, box) for one in steps)
    half_x, half_y = box[0] // 2 + 1, box[1] // 2 + 1
    telling = np.minimum(*squares)[half_y : height - half_y, half_x : width - half_x]
    if telling.shape[0] < _GRID[0] or telling.shape[1] < _GRID[1]:
        return []
    places = []
    for rows in np.array_split(np.arange(telling.shape[0]), _GRID[0]):
        for columns in np.array_split(np.arange(telling.shape[1]), _GRID[1]):
            place = telling[np.ix_(rows, columns)]
            y, x = np.unravel_index(int(place.argmax()), place.shape)
            center_x = (columns[x] + half_x) * x_scale
            center_y = (rows[y] + half_y) * y_scale
            places.append((int(center_x) - _SIDE // 2, int(center_y) - _SIDE // 2))
    return places


def _shift_of(no_flash: Photograph, flash: Photograph, x: int, y: int) -> Floats64 | None:
    """The shift (2,) of the tile with this corner; None where it cannot be told."""
    rows, columns = slice(y, y + _SIDE), slice(x, x + _SIDE)
    reference, sample = (log_detail(one[rows, columns]) for one in (no_flash, flash))
    found = finish_motion([reference], [sample], np.eye(3), SHIFT)
    if agreement(products(reference, sample, found)) < _AGREES:
        return None
    shift = found[:2, 2]
    return shift if np.hypot(*shift) < _FARTHEST else None
