"""Averages the noise of a pair away, with as many neighbours as are alike; compiled.

Source: Lee, "Digital image smoothing and the sigma filter", 1983; with gaps (à trous) Holschneider
et al. 1989.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from pipeline.arrays import Floats32
from pipeline.compiling import compiled, inlined
from pipeline.images.frames import Image, Plane
from pipeline.images.noise import Noise
from pipeline.images.strips import widened

_GAPS = (1, 2, 5, 12)  # pixels between those of the 3×3 window of each round
_JOIN = 4.2  # standard deviations of one pixel, over six channels
_CHANNELS = 6
ROUNDS = len(_GAPS)
"""Rounds that there are; fewer average less."""


def sigma_filter(
    images: tuple[Image, Image], noises: tuple[Noise, Noise], rounds: int = ROUNDS
) -> tuple[Image, Image, Plane]:
    """Filter a whole pair (h, W, 3), as SigmaFilter does."""
    height, width = images[0].shape[:2]

    def read(rows: slice, planes: Floats32) -> None:
        for image, part in zip(images, (planes[:3], planes[3:]), strict=True):
            part[...] = np.moveaxis(image[rows], -1, 0)

    return SigmaFilter(read, (width, height), noises, rounds).rows(slice(0, height))


class SigmaFilter:
    """Averages each pixel of a pair with the neighbours that differ from it only by noise.

    A neighbour joins when the six channels' squared differences, each divided by the variance
    of one pixel, sum to less than 4.2² (Lee 1983, on the pair). The 3×3 window, then such windows
    with ever wider gaps on what came out, so that flat areas are averaged widely at little cost.
    The pair is worked on from top to bottom; every row goes through every round once.
    """

    def __init__(
        self,
        read: Callable[[slice, Floats32], None],
        size: tuple[int, int],
        noises: tuple[Noise, Noise],
        rounds: int = ROUNDS,
    ) -> None:
        """Filter two photographs (H, W, 3), independent of each other.

        read: writes some rows of both into planes (6, h, W). size: (width, height) of both.
        noises: of each. rounds: how many of the windows, from the narrowest.
        """
        gain = np.concatenate([np.maximum(noise.gain, 1e-9) for noise in noises])
        floor = np.concatenate([np.maximum(noise.floor, 1e-12) for noise in noises])
        noise = gain.astype(np.float32), floor.astype(np.float32)
        stage: _Rows = _Given(read, size[0])
        for gap in _GAPS[:rounds]:
            stage = _Round(stage, gap, size, noise)
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

    def rows(self, top: int, bottom: int) -> tuple[Floats32, Plane]: ...


class _Given:
    """The pair as it is given."""

    def __init__(self, read: Callable[[slice, Floats32], None], width: int) -> None:
        self._read = read
        self._width = width

    def rows(self, top: int, bottom: int) -> tuple[Floats32, Plane]:
        planes = np.empty((_CHANNELS, bottom - top, self._width), np.float32)
        self._read(slice(top, bottom), planes)
        return planes, np.ones(planes.shape[1:], np.float32)


class _Round:
    """What comes out of one round; rows that may be asked for again are kept."""

    def __init__(
        self, before: _Rows, gap: int, size: tuple[int, int], noise: tuple[Floats32, Floats32]
    ) -> None:
        self._before = before
        self._gap = gap
        self._height = size[1]
        self._noise = noise
        self._top = self._bottom = 0
        self._planes = np.empty((_CHANNELS, 0, size[0]), np.float32)
        self._count = np.empty((0, size[0]), np.float32)

    def rows(self, top: int, bottom: int) -> tuple[Floats32, Plane]:
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

    def _filter(self, top: int, bottom: int, total: Floats32, count: Plane) -> None:
        """Write rows of the round into the last ones of its averages and their counts."""
        wide, inner = widened(slice(top, bottom), self._gap, self._height)
        planes, certainty = self._before.rows(wide.start, wide.stop)
        stable = np.empty_like(planes)
        _stabilize(planes, *self._noise, stable)
        first = total.shape[1] - (bottom - top)
        _join(planes, certainty, stable, self._gap, inner.start, first, total, count)


@compiled
def _stabilize(planes: Floats32, gain: Floats32, floor: Floats32, stable: Floats32) -> None:
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


@compiled
def _join(
    planes: Floats32,
    certainty: Plane,
    stable: Floats32,
    gap: int,
    top: int,
    first_row: int,
    total: Floats32,
    count: Plane,
) -> None:
    """One round for rows from top on: the 3×3 window with a gap.

    planes, stable: (6, h, W), the pair and the same with noise of variance one. certainty: (h, W).
    total, count: the averages and how many pixels they are of, (6, n, W) and (n, W), written from
    first_row on. Rows are worked on whole, which the compiler turns into vector instructions, but
    for the columns whose window reaches beyond the border.
    """
    _, height, width = planes.shape
    inner = max(width - 2 * gap, 0)
    joins, inverse = np.zeros((9, inner), np.float32), np.empty(inner, np.float32)
    for row in range(first_row, count.shape[0]):
        y = top + row - first_row
        for x in range(min(gap, width)):
            _join_pixel(planes, certainty, stable, gap, y, x, row, total, count)
        for x in range(gap + inner, width):
            _join_pixel(planes, certainty, stable, gap, y, x, row, total, count)
        if inner == 0:
            continue
        above, below = y - gap if y >= gap else y, y + gap if y + gap < height else y
        _compare(stable, certainty, y, y, gap, joins[3], joins[4], joins[5])
        joins[0:3], joins[6:9] = np.float32(0.0), np.float32(0.0)
        if above < y:
            _compare(stable, certainty, y, above, gap, joins[0], joins[1], joins[2])
        if below > y:
            _compare(stable, certainty, y, below, gap, joins[6], joins[7], joins[8])
        _count(joins, count[row, gap : gap + inner], inverse)
        for k in range(_CHANNELS):
            averages = total[k, row, gap : gap + inner]
            _average(joins, inverse, planes[k, above], planes[k, y], planes[k, below], averages)


@compiled
def _join_pixel(
    planes: Floats32,
    certainty: Plane,
    stable: Floats32,
    gap: int,
    y: int,
    x: int,
    row: int,
    total: Floats32,
    count: Plane,
) -> None:
    """The same for one pixel, whose window may reach beyond the border."""
    _, height, width = planes.shape
    counted, limit = np.float32(0.0), np.float32(_JOIN**2)
    total[:, row, x] = np.float32(0.0)
    for v in range(max(y % gap, y - gap), min(y + gap + 1, height), gap):
        for u in range(max(x % gap, x - gap), min(x + gap + 1, width), gap):
            squared = np.float32(0.0)
            for k in range(_CHANNELS):
                squared += (stable[k, y, x] - stable[k, v, u]) ** 2
            if squared < limit:
                counted += certainty[v, u]
                for k in range(_CHANNELS):
                    total[k, row, x] += certainty[v, u] * planes[k, v, u]
    count[row, x] = counted
    for k in range(_CHANNELS):
        total[k, row, x] /= counted


@inlined
def _compare(
    stable: Floats32, certainty: Plane, y: int, other: int, gap: int, j0: Any, j1: Any, j2: Any
) -> None:
    """Write what three neighbours in another row count for, 0 for those that do not join.

    j0, j1, j2: (n,), of those to the left, above or below, and to the right of n pixels.
    """
    zero, limit = np.float32(0.0), np.float32(_JOIN**2)
    width = stable.shape[2]
    left, middle, right = slice(width - 2 * gap), slice(gap, width - gap), slice(2 * gap, width)
    a0, a1, a2 = stable[0, y, middle], stable[1, y, middle], stable[2, y, middle]
    a3, a4, a5 = stable[3, y, middle], stable[4, y, middle], stable[5, y, middle]
    l0, l1, l2 = stable[0, other, left], stable[1, other, left], stable[2, other, left]
    l3, l4, l5 = stable[3, other, left], stable[4, other, left], stable[5, other, left]
    m0, m1, m2 = stable[0, other, middle], stable[1, other, middle], stable[2, other, middle]
    m3, m4, m5 = stable[3, other, middle], stable[4, other, middle], stable[5, other, middle]
    r0, r1, r2 = stable[0, other, right], stable[1, other, right], stable[2, other, right]
    r3, r4, r5 = stable[3, other, right], stable[4, other, right], stable[5, other, right]
    w0, w1, w2 = certainty[other, left], certainty[other, middle], certainty[other, right]
    for x in range(len(j0)):
        a = a0[x], a1[x], a2[x], a3[x], a4[x], a5[x]
        to_left = _distance(a, l0[x], l1[x], l2[x], l3[x], l4[x], l5[x])
        to_middle = _distance(a, m0[x], m1[x], m2[x], m3[x], m4[x], m5[x])
        to_right = _distance(a, r0[x], r1[x], r2[x], r3[x], r4[x], r5[x])
        j0[x] = w0[x] if to_left < limit else zero
        j1[x] = w1[x] if to_middle < limit else zero
        j2[x] = w2[x] if to_right < limit else zero


@inlined
def _distance(a: Any, b0: Any, b1: Any, b2: Any, b3: Any, b4: Any, b5: Any) -> Any:
    """Square of the distance of two pixels in six channels."""
    d0, d1, d2 = a[0] - b0, a[1] - b1, a[2] - b2
    d3, d4, d5 = a[3] - b3, a[4] - b4, a[5] - b5
    return d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3 + d4 * d4 + d5 * d5


@inlined
def _count(joins: Floats32, counted: Any, inverse: Any) -> None:
    """Write how many pixels joined, and 1 ÷ that."""
    one = np.float32(1.0)
    j0, j1, j2, j3, j4 = joins[0], joins[1], joins[2], joins[3], joins[4]
    j5, j6, j7, j8 = joins[5], joins[6], joins[7], joins[8]
    for x in range(len(counted)):
        counted[x] = j0[x] + j1[x] + j2[x] + j3[x] + j4[x] + j5[x] + j6[x] + j7[x] + j8[x]
        inverse[x] = one / counted[x]


@inlined
def _average(
    joins: Floats32, inverse: Any, above: Any, own: Any, below: Any, averages: Any
) -> None:
    """Write averages (n,) of one channel over the pixels that joined from three rows (W,)."""
    gap, width = (len(own) - len(averages)) // 2, len(own)
    left, middle, right = slice(width - 2 * gap), slice(gap, width - gap), slice(2 * gap, width)
    j0, j1, j2, j3, j4 = joins[0], joins[1], joins[2], joins[3], joins[4]
    j5, j6, j7, j8 = joins[5], joins[6], joins[7], joins[8]
    v0, v1, v2 = above[left], above[middle], above[right]
    v3, v4, v5 = own[left], own[middle], own[right]
    v6, v7, v8 = below[left], below[middle], below[right]
    for x in range(len(averages)):
        above_sum = j0[x] * v0[x] + j1[x] * v1[x] + j2[x] * v2[x]
        own_sum = j3[x] * v3[x] + j4[x] * v4[x] + j5[x] * v5[x]
        below_sum = j6[x] * v6[x] + j7[x] * v7[x] + j8[x] * v8[x]
        averages[x] = (above_sum + own_sum + below_sum) * inverse[x]
