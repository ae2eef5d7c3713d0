"""Differences across the edges of shadows, which show the lamp that is shadowed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Mask
from pipeline.matrixfit.chromaticities import Chromaticities
from pipeline.matrixfit.contrasts import Places, RelativeLight, contrast, steps

_SAME_SHADING = 0.15  # logarithm of the flash part
_BEYOND = 0.5  # change of light on both sides of a shadow's edge, of that across it
_LEAST_STEP = 0.25  # of the mean light relative to the flash
_LEAST_FALL, _SURE = 0.2, 8.0  # of the light on the lit side; standard deviations of the step
_FACTORS, _SURFACE = np.array([1.0, -1.0]), np.array([0.5, 0.5])


def find_differences(ratios: RelativeLight) -> list[Chromaticities]:
    """Differences across edges of shadows, by direction; weights are their worth."""
    return [contrast(ratios, at, _FACTORS, _SURFACE) for at in shadow_edges(ratios)]


def shadow_edges(ratios: RelativeLight) -> Iterator[Places]:
    """Rows and columns (n, 2) of neighbours alike under the flash, by direction.

    From where a lamp shines to where it does not; only where the light does not go on changing
    beyond them: across the edge of a shadow one lamp changes, along a bent surface all of them do.
    """
    use, light = ratios.use, ratios.total
    if not use.any():
        return
    least = _LEAST_STEP * float(light[use].mean())
    for ox, oy in steps(use.shape):
        a, b = _shifted(use.shape, ox, oy)
        good = use[a] & use[b]
        good &= np.abs(np.log(ratios.strength[a] / ratios.strength[b])) < _SAME_SHADING
        good &= (np.abs(light[a] - light[b]) > least) & _is_edge(light, use, ox, oy)
        rows, columns = np.nonzero(good)
        rows = rows + max(-oy, 0)
        one, other = (rows, columns), (rows + oy, columns + ox)
        swap = (light[one] < light[other]) * 1
        rows = rows[:, None] + oy * np.stack([swap, 1 - swap], axis=1)
        columns = columns[:, None] + ox * np.stack([swap, 1 - swap], axis=1)
        same = ratios.alike(one, other)
        at = rows[same], columns[same]
        clear = _is_clear(ratios, at)
        yield at[0][clear], at[1][clear]


def _shifted(
    shape: tuple[int, ...], ox: int, oy: int
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Two views of an image, pixel by pixel (ox, oy) apart; ox ≥ 0."""
    height, width = shape
    rows = (slice(0, height - abs(oy)), slice(abs(oy), height))
    a_rows, b_rows = rows if oy >= 0 else rows[::-1]
    return (a_rows, slice(0, width - ox)), (b_rows, slice(ox, width))


def _is_clear(ratios: RelativeLight, at: Places) -> Mask:
    """Whether steps (n,) are much of the light, or beyond noise.

    Where light fades evenly noise makes steps that seem to end, most of all where lamps are bright
    and the flash is dim.
    """
    lit, dark = ratios.total[at].T
    deviation = np.sqrt(ratios.covariance(at).sum(axis=(1, 2, 3)))
    step = lit - dark
    return np.asarray((step > _LEAST_FALL * lit) | (step > _SURE * deviation))


def _is_edge(light: Floats64, use: Mask, ox: int, oy: int) -> Mask:
    """Whether the light changes between two pixels (ox, oy) apart and hardly beyond them."""
    padded = np.pad(np.where(use, light, np.nan), ((abs(oy), abs(oy)), (ox, ox)), mode="edge")
    height, width = light.shape
    inner = (slice(abs(oy), abs(oy) + height), slice(ox, ox + width))

    def at(count: int) -> Floats64:
        rows = slice(inner[0].start + count * oy, inner[0].stop + count * oy)
        columns = slice(inner[1].start + count * ox, inner[1].stop + count * ox)
        return padded[rows, columns]

    before, after = np.abs(at(-1) - light), np.abs(at(1) - light)
    a, b = _shifted(use.shape, ox, oy)
    # what lies outside or cannot be used says nothing
    beyond = np.nan_to_num(before[a]) + np.nan_to_num(after[b])
    return np.asarray(beyond < _BEYOND * np.abs(light[a] - light[b]))
