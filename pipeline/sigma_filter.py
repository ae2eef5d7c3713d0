"""Averages the noise of a pair away, with as many neighbours as are alike; compiled.

Source: Lee, "Digital image smoothing and the sigma filter", 1983; with gaps (à trous) Holschneider
et al. 1989.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.frames import Image
from pipeline.noise import Noise

Planes = NDArray[np.float32]

_WINDOWS = ((2, 1), (1, 3), (1, 6), (1, 12))  # reach and gap of each round
_JOIN = 4.2  # standard deviations of one pixel, over six channels
_CHANNELS = 6
HALO = sum(reach * gap for reach, gap in _WINDOWS)
"""Rows that sigma_filter needs beyond either end of a strip."""


def sigma_filter(
    images: tuple[Image, Image], noises: tuple[Noise, Noise], keep: slice = slice(None)
) -> tuple[Image, Image, NDArray[np.float32]]:
    """Average each pixel of a pair with the neighbours that differ from it only by noise.

    A neighbour joins when the six channels' squared differences, each divided by the variance
    of one pixel, sum to less than 4.2² (Lee 1983, on the pair). First the 5×5 window, then 3×3
    windows with ever wider gaps on what came out, so that flat areas are averaged widely at little
    cost.

    Parameters
    ----------
    images : two (h, W, 3) photographs, independent of each other
    noises : the noise of each
    keep : the rows to return; the others, HALO on either side or up to the border, are halo

    Returns
    -------
    two (len(keep), W, 3) filtered photographs, and (len(keep), W) how many pixels were averaged
    """
    planes = np.ascontiguousarray(np.concatenate(images, axis=2).transpose(2, 0, 1))
    certainty = np.ones(planes.shape[1:], dtype=np.float32)  # pixels averaged so far
    for reach, gap in _WINDOWS:
        stable = np.empty_like(planes)
        for i, noise in enumerate(noises):
            stable[3 * i : 3 * i + 3] = noise.stabilize(planes[3 * i : 3 * i + 3])
        total, count = np.empty_like(planes), np.empty_like(certainty)
        _join(planes, certainty, stable, reach, gap, np.float32(_JOIN**2), total, count)
        planes, certainty = total, count
    kept = planes[:, keep].transpose(1, 2, 0)
    first, second = (np.ascontiguousarray(kept[..., part]) for part in (slice(3), slice(3, 6)))
    return first, second, certainty[keep]


@njit(cache=True)
def _join(
    planes: Planes,
    certainty: Planes,
    stable: Planes,
    reach: int,
    gap: int,
    limit: np.float32,
    total: Planes,
    count: Planes,
) -> None:
    """One round: neighbours at −reach … reach gaps in both axes.

    planes, stable: (6, h, W), the pair and the same with noise of variance one. certainty: (h, W).
    total, count: the averages and how many pixels they are of, overwritten. Rows are worked on
    whole, plane by plane, which the compiler turns into vector instructions.
    """
    zero = np.float32(0.0)
    _, height, width = planes.shape
    scratch = np.empty(width, np.float32)
    for y in range(height):
        for x in range(width):
            count[y, x] = certainty[y, x]
        for k in range(_CHANNELS):
            for x in range(width):
                total[k, y, x] = planes[k, y, x] * certainty[y, x]
        for dy in range(-reach, reach + 1):
            other = y + dy * gap
            if other < 0 or other >= height:
                continue
            for dx in range(-reach, reach + 1):
                if dx == 0 and dy == 0:
                    continue
                shift = dx * gap
                low, high = max(0, -shift), min(width, width - shift)
                if low >= high:
                    continue
                joins = scratch[: high - low]
                for x in range(high - low):
                    joins[x] = zero
                for k in range(_CHANNELS):
                    here = stable[k, y, low:high]
                    there = stable[k, other, low + shift : high + shift]
                    for x in range(high - low):
                        step = here[x] - there[x]
                        joins[x] += step * step
                weight = certainty[other, low + shift : high + shift]
                counted = count[y, low:high]
                for x in range(high - low):
                    joins[x] = weight[x] if joins[x] < limit else zero
                    counted[x] += joins[x]
                for k in range(_CHANNELS):
                    summed = total[k, y, low:high]
                    there = planes[k, other, low + shift : high + shift]
                    for x in range(high - low):
                        summed[x] += joins[x] * there[x]
        for k in range(_CHANNELS):
            for x in range(width):
                total[k, y, x] /= count[y, x]
