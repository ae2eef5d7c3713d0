"""Averages the noise of a pair away, with as many neighbours as are alike; compiled.

Source: Lee, "Digital image smoothing and the sigma filter", 1983; with gaps (à trous) Holschneider
et al. 1989.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.frames import Image, planes_of
from pipeline.noise import Noise

Planes = NDArray[np.float32]

_WINDOWS = ((2, 1), (1, 3), (1, 6), (1, 12))  # reach and gap of each round
_JOIN = 4.2  # standard deviations of one pixel, over six channels
_CHANNELS = 6
ROUNDS = len(_WINDOWS)
"""Rounds that there are; fewer average less."""


def halo(rounds: int) -> int:
    """Rows that sigma_filter needs beyond either end of a strip."""
    return sum(reach * gap for reach, gap in _WINDOWS[:rounds])


def sigma_filter(
    images: tuple[Image, Image],
    noises: tuple[Noise, Noise],
    keep: slice = slice(None),
    rounds: int = ROUNDS,
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
    keep : the rows to return; the others, halo(rounds) on either side or up to the border, are
        around them
    rounds : how many of the windows, from the narrowest

    Returns
    -------
    two (len(keep), W, 3) filtered photographs, laid by planes, and (len(keep), W) how many pixels
    were averaged
    """
    planes = np.stack([plane for image in images for plane in planes_of(image)])
    height = planes.shape[1]
    first, last, _ = keep.indices(height)
    gain = np.concatenate([np.maximum(noise.gain, 1e-9) for noise in noises]).astype(np.float32)
    floor = np.concatenate([np.maximum(noise.floor, 1e-12) for noise in noises]).astype(np.float32)
    stable, total = np.empty_like(planes), np.empty_like(planes)
    certainty = np.ones(planes.shape[1:], dtype=np.float32)  # pixels averaged so far
    count = np.empty_like(certainty)
    top, bottom, around = 0, height, halo(rounds)
    for reach, gap in _WINDOWS[:rounds]:
        _stabilize(planes, gain, floor, top, bottom, stable)
        around -= reach * gap
        top, bottom = max(first - around, 0), min(last + around, height)
        _join(planes, certainty, stable, reach, gap, top, bottom, total, count)
        planes, total = total, planes
        certainty, count = count, certainty
    kept = np.moveaxis(planes[:, keep], 0, -1)
    return kept[..., :3], kept[..., 3:], certainty[keep]


@njit(cache=True, error_model="numpy")
def _stabilize(
    planes: Planes, gain: Planes, floor: Planes, top: int, bottom: int, stable: Planes
) -> None:
    """Write rows top…bottom of planes (6, h, W) so that their noise has unit variance everywhere.

    Source: Anscombe 1948, for the noise of a photograph. gain, floor: (6,).
    """
    zero, two = np.float32(0.0), np.float32(2.0)
    for k in range(_CHANNELS):
        scale, slope, level = two / gain[k], gain[k], floor[k]
        for y in range(top, bottom):
            values, written = planes[k, y], stable[k, y]
            for x in range(values.shape[0]):
                written[x] = scale * np.sqrt(slope * max(values[x], zero) + level)


@njit(cache=True, error_model="numpy")
def _join(
    planes: Planes,
    certainty: Planes,
    stable: Planes,
    reach: int,
    gap: int,
    top: int,
    bottom: int,
    total: Planes,
    count: Planes,
) -> None:
    """One round for rows top…bottom: neighbours at −reach … reach gaps in both axes.

    planes, stable: (6, h, W), the pair and the same with noise of variance one. certainty: (h, W).
    total, count: the averages and how many pixels they are of, overwritten. Rows are worked on
    whole, plane by plane, which the compiler turns into vector instructions.
    """
    zero, limit = np.float32(0.0), np.float32(_JOIN**2)
    _, height, width = planes.shape
    scratch = np.empty(width, np.float32)
    for y in range(top, bottom):
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
                first, last = low + shift, high + shift
                weight, joins = certainty[other, first:last], scratch[: high - low]
                a0, b0 = stable[0, y, low:high], stable[0, other, first:last]
                a1, b1 = stable[1, y, low:high], stable[1, other, first:last]
                a2, b2 = stable[2, y, low:high], stable[2, other, first:last]
                a3, b3 = stable[3, y, low:high], stable[3, other, first:last]
                a4, b4 = stable[4, y, low:high], stable[4, other, first:last]
                a5, b5 = stable[5, y, low:high], stable[5, other, first:last]
                for x in range(high - low):
                    d0, d1, d2 = a0[x] - b0[x], a1[x] - b1[x], a2[x] - b2[x]
                    d3, d4, d5 = a3[x] - b3[x], a4[x] - b4[x], a5[x] - b5[x]
                    squared = d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3 + d4 * d4 + d5 * d5
                    joins[x] = weight[x] if squared < limit else zero
                counted = count[y, low:high]
                for x in range(high - low):
                    counted[x] += joins[x]
                for k in range(_CHANNELS):  # one by one: of more the compiler makes no vectors
                    sums, values = total[k, y, low:high], planes[k, other, first:last]
                    for x in range(high - low):
                        sums[x] += joins[x] * values[x]
        for k in range(_CHANNELS):
            for x in range(width):
                total[k, y, x] /= count[y, x]
