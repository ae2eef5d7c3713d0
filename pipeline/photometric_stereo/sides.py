"""To which part of a surface pixels about a jump of depth belong, by the pair itself.

Where a surface ends before another it turns away from the camera: the flash part changes at once,
and so does what the lamps give for each unit of it. Paint hardly changes the latter, the edge of a
shadow not the former. So pixels belong to the part from which the way over the least such changes
leads to them: the image foresting transform (Falcão, Stolfi and Lotufo 2004).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from pipeline.arrays import Floats64
from pipeline.images.frames import Mask

Parts = NDArray[np.intp]

_STEP = 0.01  # of a way, where nothing changes
_JUMP = 0.1  # relative change at once of both flash part and what the lamps give beside it
_LEAST = 1e-6  # of the light
_MIDDLE = 0.7  # of the way into a thin part


def sides(flash: Floats64, light: Floats64, mask: Mask, parts: Parts, reach: float) -> Parts:
    """Number (H, W) of the part that each pixel of a mask belongs to, 0 outside.

    flash, light: (H, W), the flash part and the light of the lamps, sums over the channels, > 0 in
    the mask. parts: (H, W) from 1, inside the mask, 0 where it is not known which. reach: pixels
    that the parts may be wrong by where they meet: so near to another part they are told anew.
    """
    if len(np.unique(parts[parts > 0])) < 2:
        return np.where(mask, parts.max(initial=0), 0)
    sure = _sure(parts, mask, reach)
    number = np.full(mask.shape, -1)
    number[mask] = np.arange(mask.sum())
    starts = np.flatnonzero(sure[mask])
    _, _, origin = dijkstra(
        _ways(flash, light, mask, number),
        directed=False,
        indices=starts,
        min_only=True,
        return_predecessors=True,
    )
    found = np.zeros(mask.shape, np.intp)
    led = origin >= 0
    found[mask] = np.where(led, sure[mask][np.where(led, origin, 0)], 0)
    return np.where(mask, _nearest(found), 0)  # to islands no way leads


def jumps(flash: Floats64, light: Floats64, mask: Mask) -> Mask:
    """Pixels (H, W) beside which flash part and light for each unit of it change at once.

    flash, light: (H, W), sums over the channels, > 0 in the mask. Depth may jump there; a crease is
    told as well, an edge of paint or of a shadow not.
    """
    turned, lit = _logarithms(flash, light)
    found = np.zeros_like(mask)
    for one, other in _neighbours(mask.shape, ((0, 1), (1, 0))):
        change = np.minimum(np.abs(turned[one] - turned[other]), np.abs(lit[one] - lit[other]))
        jump = (change > _JUMP) & mask[one] & mask[other]
        found[one] |= jump
        found[other] |= jump
    return found


def _nearest(parts: Parts) -> Parts:
    """The part that is nearest to each pixel (H, W)."""
    at = ndimage.distance_transform_edt(parts == 0, return_distances=False, return_indices=True)
    return np.asarray(parts[tuple(at)])


def _sure(parts: Parts, mask: Mask, reach: float) -> Parts:
    """The parts (H, W) without what is near to another; of thin ones the middle is left."""
    own = np.where(mask, _nearest(parts), 0)
    sure = np.zeros_like(parts)
    for part in np.unique(parts[parts > 0]):
        to_others = ndimage.distance_transform_edt((own == 0) | (own == part))
        inside = parts == part
        far = to_others > min(reach, _MIDDLE * to_others[inside].max())
        sure[inside & far] = part
    return sure


def _ways(flash: Floats64, light: Floats64, mask: Mask, number: Parts) -> coo_array:
    """The ways (n, n) between neighbouring pixels of a mask, also across corners."""
    turned, lit = _logarithms(flash, light)
    rows, columns, lengths = [], [], []
    for one, other in _neighbours(mask.shape, ((0, 1), (1, 0), (1, 1), (1, -1))):
        both = mask[one] & mask[other]
        change = np.abs(turned[one] - turned[other]) * np.abs(lit[one] - lit[other])
        rows.append(number[one][both])
        columns.append(number[other][both])
        lengths.append(_STEP + change[both])
    size = int(mask.sum())
    ways = np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))
    return coo_array(ways, shape=(size, size))


def _logarithms(flash: Floats64, light: Floats64) -> tuple[Floats64, Floats64]:
    """Of the flash part (H, W) and of the lamps' light for each unit of it."""
    turned = np.log(np.maximum(flash, _LEAST))
    return turned, np.log(np.maximum(light, _LEAST)) - turned


def _neighbours(
    shape: tuple[int, ...], steps: Iterable[tuple[int, int]]
) -> Iterator[tuple[tuple[slice, slice], tuple[slice, slice]]]:
    """Where in a picture of a shape pixels and those that lie so many (down, across) from them are.

    down: 0 or more.
    """
    height, width = shape
    for down, across in steps:
        one = np.s_[: height - down, max(-across, 0) : width - max(across, 0)]
        yield one, np.s_[down:, max(across, 0) : width + min(across, 0)]
