"""Averages the noise of a pair away, with as many neighbours as are alike; compiled.

Source: Lee, "Digital image smoothing and the sigma filter", 1983; with gaps (à trous) Holschneider
et al. 1989.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.frames import Image, Plane, planes_of
from pipeline.noise import Noise
from pipeline.strips import widened

Array = NDArray[np.float32]
Planes = NDArray[np.float32]

_WINDOWS = ((2, 1), (1, 3), (1, 6), (1, 12))  # reach and gap of each round
_JOIN = 4.2  # standard deviations of one pixel, over six channels
_CHANNELS = 6
ROUNDS = len(_WINDOWS)
"""Rounds that there are; fewer average less."""


def sigma_filter(
    images: tuple[Image, Image], noises: tuple[Noise, Noise], rounds: int = ROUNDS
) -> tuple[Image, Image, Plane]:
    """Filter a whole pair (h, W, 3), as SigmaFilter does."""
    height, width = images[0].shape[:2]

    def read(rows: slice) -> tuple[Image, Image]:
        return images[0][rows], images[1][rows]

    return SigmaFilter(read, (width, height), noises, rounds).rows(slice(0, height))


class SigmaFilter:
    """Averages each pixel of a pair with the neighbours that differ from it only by noise.

    A neighbour joins when the six channels' squared differences, each divided by the variance
    of one pixel, sum to less than 4.2² (Lee 1983, on the pair). First the 5×5 window, then 3×3
    windows with ever wider gaps on what came out, so that flat areas are averaged widely at little
    cost. The pair is worked on from top to bottom; every row goes through every round once.
    """

    def __init__(
        self,
        read: Callable[[slice], tuple[Image, Image]],
        size: tuple[int, int],
        noises: tuple[Noise, Noise],
        rounds: int = ROUNDS,
    ) -> None:
        """Filter two photographs (H, W, 3), independent of each other.

        read: gives some rows of them. size: (width, height) of both. noises: of each. rounds: how
        many of the windows, from the narrowest.
        """
        gain = np.concatenate([np.maximum(noise.gain, 1e-9) for noise in noises])
        floor = np.concatenate([np.maximum(noise.floor, 1e-12) for noise in noises])
        noise = gain.astype(np.float32), floor.astype(np.float32)
        stage: _Rows = _Given(read)
        for reach, gap in _WINDOWS[:rounds]:
            stage = _Round(stage, reach, gap, size, noise)
        self._last = stage

    def rows(self, rows: slice) -> tuple[Image, Image, Plane]:
        """Filtered rows, which neither begin nor end above those asked for before.

        Returns two (h, W, 3) photographs, laid by planes, and (h, W) how many pixels were averaged.
        """
        planes, certainty = self._last.rows(rows.start, rows.stop)
        pixels = np.moveaxis(planes, 0, -1)
        return pixels[..., :3], pixels[..., 3:], certainty


class _Rows(Protocol):
    """Rows of the pair, by planes (6, h, W), and (h, W) how many pixels were averaged so far."""

    def rows(self, top: int, bottom: int) -> tuple[Planes, Plane]: ...


class _Given:
    """The pair as it is given."""

    def __init__(self, read: Callable[[slice], tuple[Image, Image]]) -> None:
        self._read = read

    def rows(self, top: int, bottom: int) -> tuple[Planes, Plane]:
        images = self._read(slice(top, bottom))
        planes = np.stack([plane for image in images for plane in planes_of(image)])
        return planes, np.ones(planes.shape[1:], np.float32)


class _Round:
    """What comes out of one round; rows that may be asked for again are kept."""

    def __init__(
        self, before: _Rows, reach: int, gap: int, size: tuple[int, int], noise: tuple[Array, Array]
    ) -> None:
        self._before = before
        self._reach, self._gap = reach, gap
        self._height = size[1]
        self._noise = noise
        self._top = self._bottom = 0
        self._planes = np.empty((_CHANNELS, 0, size[0]), np.float32)
        self._count = np.empty((0, size[0]), np.float32)

    def rows(self, top: int, bottom: int) -> tuple[Planes, Plane]:
        kept = max(self._bottom - top, 0)
        planes = np.empty((_CHANNELS, bottom - top, self._planes.shape[2]), np.float32)
        count = np.empty(planes.shape[1:], np.float32)
        planes[:, :kept] = self._planes[:, top - self._top : bottom - self._top]
        count[:kept] = self._count[top - self._top : bottom - self._top]
        if bottom > self._bottom:
            self._filter(top + kept, bottom, planes, count)
        self._planes, self._count = planes, count
        self._top, self._bottom = top, bottom
        return planes, count

    def _filter(self, top: int, bottom: int, total: Planes, count: Plane) -> None:
        """Write rows of the round into the last ones of its averages and their counts."""
        around = self._reach * self._gap
        wide, inner = widened(slice(top, bottom), around, self._height)
        planes, certainty = self._before.rows(wide.start, wide.stop)
        stable = np.empty_like(planes)
        _stabilize(planes, *self._noise, stable)
        first = total.shape[1] - (bottom - top)
        _join(planes, certainty, stable, self._reach, self._gap, inner.start, first, total, count)


@njit(cache=True, error_model="numpy")
def _stabilize(planes: Planes, gain: Array, floor: Array, stable: Planes) -> None:
    """Write planes (6, h, W) so that their noise has unit variance everywhere.

    Source: Anscombe 1948, for the noise of a photograph. gain, floor: (6,).
    """
    zero, two = np.float32(0.0), np.float32(2.0)
    for k in range(_CHANNELS):
        scale, slope, level = two / gain[k], gain[k], floor[k]
        for y in range(planes.shape[1]):
            values, written = planes[k, y], stable[k, y]
            for x in range(values.shape[0]):
                written[x] = scale * np.sqrt(slope * max(values[x], zero) + level)


@njit(cache=True, error_model="numpy")
def _join(
    planes: Planes,
    certainty: Plane,
    stable: Planes,
    reach: int,
    gap: int,
    top: int,
    first_row: int,
    total: Planes,
    count: Plane,
) -> None:
    """One round for rows from top on: neighbours at −reach … reach gaps in both axes.

    planes, stable: (6, h, W), the pair and the same with noise of variance one. certainty: (h, W).
    total, count: the averages and how many pixels they are of, (6, n, W) and (n, W), written from
    first_row on. Rows are worked on whole, plane by plane, which the compiler turns into vector
    instructions.
    """
    zero, limit = np.float32(0.0), np.float32(_JOIN**2)
    _, height, width = planes.shape
    scratch = np.empty(width, np.float32)
    for row in range(first_row, count.shape[0]):
        y = top + row - first_row
        for x in range(width):
            count[row, x] = certainty[y, x]
        for k in range(_CHANNELS):
            for x in range(width):
                total[k, row, x] = planes[k, y, x] * certainty[y, x]
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
                counted = count[row, low:high]
                for x in range(high - low):
                    counted[x] += joins[x]
                for k in range(_CHANNELS):  # one by one: of more the compiler makes no vectors
                    sums, values = total[k, row, low:high], planes[k, other, first:last]
                    for x in range(high - low):
                        sums[x] += joins[x] * values[x]
        for k in range(_CHANNELS):
            for x in range(width):
                total[k, row, x] /= count[row, x]
