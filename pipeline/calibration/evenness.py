"""Whether an area of a pair shows one even surface."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats, Floats64
from pipeline.calibration.lamps_and_flash import lamps_and_flash
from pipeline.errors import OptionError
from pipeline.images.frames import Mask
from pipeline.pair.pair import Pair

_CELLS = 8  # along a side of the area
_ENOUGH = 2**18  # pixels
_UNEVEN_COLOUR, _UNEVEN_LIGHT = 0.03, 0.05
"""Root mean squares, relative to the mean light; a card that shades off stays far below."""
_NOISE = 3.0  # standard deviations: how noise hangs together is known roughly


def check_even(pair: Pair, mask: Mask) -> None:
    """Raise OptionError where the flash does not show one even surface where a grey card is marked.

    mask: bool (H, W), with usable pixels lit by the flash. Brightness may shade
    off, as a square polynomial of the place.
    """
    flash, variance, places = _cells(pair, mask & ~pair.unusable)
    mean = flash.mean(axis=0)
    brightness = flash.sum(axis=1, keepdims=True) / mean.sum()
    noise = _NOISE**2 * float((variance / mean**2).mean())
    x, y = places.T
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    shading = terms @ np.linalg.lstsq(terms, brightness, rcond=None)[0]
    for uneven, limit in (
        (flash / mean - brightness, _UNEVEN_COLOUR),
        (brightness - shading, _UNEVEN_LIGHT),
    ):
        if np.square(uneven).mean() > limit**2 + noise:
            raise OptionError(
                "The mark of the grey card shows more than one even surface in the light of the "
                "flash: check its coordinates, which are pixels of the photograph without the "
                "flash, and keep it within the edges, without gloss or shadows."
            )


def _cells(pair: Pair, open_: Mask) -> tuple[Floats64, Floats64, Floats64]:
    """Mean light of the flash (n, 3) in cells of an area, its variance, and places (n, 2) in −1…1.

    open_: bool (H, W), not empty.
    """
    inside = np.flatnonzero(open_)
    at = np.stack(np.unravel_index(inside[:: -(-len(inside) // _ENOUGH)], open_.shape), axis=1)
    low, high = at.min(axis=0), at.max(axis=0) + 1
    scaled = (at + 0.5 - low) / (high - low)
    numbers = (scaled * _CELLS).astype(np.intp) @ (_CELLS, 1)
    _, cells, counts = np.unique(numbers, return_inverse=True, return_counts=True)

    def means(values: Floats) -> Floats64:
        sums = [np.bincount(cells, column, len(counts)) for column in values.T]
        return np.stack(sums, axis=1) / counts[:, None]

    no_flash, flash = (means(frame[at[:, 0], at[:, 1]]) for frame in (pair.no_flash, pair.flash))
    lights = lamps_and_flash(pair, no_flash, flash, counts[:, None].astype(float))
    return lights.flash, lights.flash_variance, 2 * means(scaled) - 1
