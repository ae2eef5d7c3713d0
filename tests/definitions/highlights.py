"""What is compiled in pipeline.highlights, block by block in plain NumPy and double precision."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pipeline.frames import Image
from pipeline.highlights import Highlights
from pipeline.lamps import Lamps
from pipeline.reduced import ReducedPair
from tests.definitions.pixels import light_of_lamps, shares

Doubles = NDArray[np.float64]

_MODEL, _SHADING, _LEAST_SHADING = 0.017, 0.5, 0.1
_MOST_UNUSUAL, _WORTH, _WORTH_OF_RIM, _MOST_WORTH = 3.0, 6.0, 3.0, 12.0
_AGREEING, _REACH, _STEPS = 5, 0.047, 4
_ALIKE, _LEAST_ALIKE = 0.015, 2.0


def find_highlights(reduced: ReducedPair, lamps: Lamps, flash_white: Doubles) -> Highlights | None:
    """pipeline.highlights.find_highlights."""
    if len(lamps) != 2:
        return None
    colours = lamps.matrices @ flash_white
    weights, size = lamps.channel_weights, reduced.usable.shape
    seen, light = reduced.no_flash * weights, light_of_lamps(reduced.flash, lamps) * weights
    matt, left = _matt(reduced, lamps, seen, light)
    around, kind, worth = np.zeros((2, *size)), np.full(size, -1), np.full(size, -_MOST_WORTH)
    for y, x in np.argwhere(reduced.usable & (left > _MODEL)):
        like, shares_there = _neighbours(reduced, matt, y, x)
        if like.sum() < _LEAST_ALIKE:
            continue
        s = np.array([_median(one, like) for one in shares_there])
        around[:, y, x] = s
        unusual = np.square((matt[:, y, x] - s) / (s + _LEAST_SHADING * s.sum() + 1e-12)).sum()
        of_matt = (left[y, x] / _MODEL) ** 2 + _bounded(unusual)
        of_kinds = [
            _cost_of_mirrored(seen[y, x], s @ light[:, y, x], mirrored * weights)
            for mirrored in _mirrored(colours, s)
        ]
        if np.isfinite(min(of_kinds)):
            kind[y, x] = int(np.argmin(of_kinds))
            worth[y, x] = np.clip(of_matt - min(of_kinds), -_MOST_WORTH, _MOST_WORTH)
    found, rim = (kind >= 0) & (_mean(worth, _AGREEING) > _WORTH), np.zeros(size, np.bool_)
    for y, x in np.argwhere(found):
        rows, columns = slice(max(y - 2, 0), y + 3), slice(max(x - 2, 0), x + 3)
        rim[rows, columns] = True
    found |= rim & (kind >= 0) & (worth > _WORTH_OF_RIM)
    if not found.any():
        return None
    beside = np.array([_mean(one * found, 3) for one in around])
    beside /= np.maximum(_mean(found.astype(np.float64), 3), 1e-12)
    planes = [found & (kind == 0), found & (kind == 1), found & (kind == 2)]
    blocks = np.stack([*planes, *np.where(found, around, beside)], axis=2, dtype=np.float32)
    return Highlights(blocks, reduced.block, colours)


def _matt(
    reduced: ReducedPair, lamps: Lamps, seen: Doubles, light: Doubles
) -> tuple[Doubles, Doubles]:
    """Shares (2, h, w) of matt light, and what they leave over of it, relative, less noise."""
    z = shares(seen, light).astype(np.float64)
    off = seen - np.einsum("nhw,nhwk->hwk", z, light)
    mixed = np.einsum("nhw,nkc->hwkc", z, lamps.matrices)
    variance = np.einsum("hwkc,hwc->hwk", np.square(mixed), reduced.flash_variance)
    variance = (variance + reduced.no_flash_variance) * np.square(lamps.channel_weights)
    left = np.maximum((np.square(off) - variance).sum(axis=2), 0.0)
    return z, np.sqrt(left / np.maximum(np.square(seen).sum(axis=2), 1e-12))


def _neighbours(reduced: ReducedPair, matt: Doubles, y: int, x: int) -> tuple[Doubles, Doubles]:
    """How like a block those around it are (n,), and their shares (2, n)."""
    step = max(round(_REACH * max(reduced.usable.shape) / _STEPS), 1)
    rows, columns = (
        [i for i in middle + step * np.arange(-_STEPS, _STEPS + 1) if 0 <= i < size]
        for middle, size in zip((y, x), reduced.usable.shape, strict=True)
    )
    near = np.ix_(rows, columns)
    usable = reduced.usable[near]
    flash = reduced.flash[near][usable].astype(np.float64)
    off = _chromaticity(flash) - _chromaticity(reduced.flash[y, x].astype(np.float64))
    like = np.exp(-np.square(off).sum(axis=-1) / (2 * _ALIKE**2))
    return like, np.array([one[near][usable] for one in matt])


def _cost_of_mirrored(seen: Doubles, matt: Doubles, mirrored: Doubles) -> float:
    """How far weighed light (3,) is from the highlight; infinite where nothing is mirrored."""
    a, b = shares(seen, np.stack([matt, mirrored])).astype(np.float64)
    if not b > 0:
        return np.inf
    left = np.square(seen - a * matt - b * mirrored).sum()
    whole = max(np.square(seen).sum(), 1e-12)
    return float(left / whole / _MODEL**2 + _bounded((a - 1.0) ** 2))


def _mirrored(colours: Doubles, s: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Light of the first lamp, of the second, and what the flash's part pretends, (…, 3)."""
    return colours[0], colours[1], -np.einsum("n...,nk->...k", s, colours)


def _bounded(unusual: float) -> float:
    squared = unusual / _SHADING**2
    return _MOST_UNUSUAL * squared / (_MOST_UNUSUAL + squared)


def _median(values: Doubles, weights: Doubles) -> float:
    """The least value with half of the weight at or below it."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * weights.sum())])


def _chromaticity(flash: Doubles) -> Doubles:
    return np.asarray(flash[..., :2] / np.maximum(flash.sum(axis=-1, keepdims=True), 1e-12))


def _mean(values: Doubles, side: int) -> Doubles:
    """Mean over side × side blocks around each, mirrored at the border."""
    wide = np.pad(values, side // 2, mode="reflect")
    return np.asarray(sliding_window_view(wide, (side, side)).mean(axis=(2, 3)))


def deal_out(
    highlights: Highlights, no_flash: Image, flash: Image, lamps: Lamps, proportions: Image
) -> Image:
    """pipeline.highlights.Highlights.deal_out, of a whole picture."""
    planes = enlarged(highlights.blocks, highlights.side, flash.shape[:2])
    weights, s, c = planes[:3, ..., None], planes[3:], highlights.colours
    matt = s[..., None] * light_of_lamps(flash, lamps)
    channels = lamps.channel_weights
    lamp_or_not = np.array([[1, 0], [0, 1], [0, 0]])
    out = proportions.astype(np.float64)
    for kind, mirrored in enumerate(_mirrored(c, s)):
        columns = np.stack([matt.sum(axis=0), np.broadcast_to(mirrored, flash.shape)])
        a, b = shares(no_flash * channels, columns * channels)[..., None].astype(np.float64)
        of_lamps = lamp_or_not[kind][:, None, None] if kind < 2 else -s
        light = np.maximum(a * matt + b * of_lamps[..., None] * c[:, None, None], 0.0)
        total = light.sum(axis=0)
        dealt = np.where(total > 0, light / np.where(total > 0, total, 1.0), proportions)
        out += weights[kind] * (dealt - proportions)
    return out.astype(np.float32)


def enlarged(blocks: Image, side: int, size: tuple[int, int]) -> Doubles:
    """pipeline.enlarge.enlarge: planes (P, H, W), linear between the middles of blocks."""
    planes = np.moveaxis(blocks, 2, 0).astype(np.float64)
    for axis in (1, 2):
        place = (np.arange(size[axis - 1]) + 0.5) / side - 0.5
        known = np.arange(planes.shape[axis])
        planes = np.apply_along_axis(lambda line: np.interp(place, known, line), axis, planes)  # noqa: B023
    return planes
