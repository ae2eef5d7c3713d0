"""What is compiled for highlights in pipeline.separation, block by block in NumPy and float64."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.images.frames import Image
from pipeline.lamps.lamps import Lamps
from pipeline.pair.reduced import ReducedPair
from pipeline.separation.highlights import Highlights
from tests.definitions.pixels import light_of_lamps, shares

_MODEL, _SHADING, _LEAST_SHADING = 0.017, 0.5, 0.1
_MOST_UNUSUAL, _WORTH, _WORTH_OF_RIM, _MOST_WORTH = 3.0, 6.0, 1.0, 12.0
_BRIGHT, _NOTABLE, _BRIGHTER, _MOST_BRIGHT = 0.85, 1.2, 0.2, 12.0
_AGREEING, _REACH, _STEPS = 5, 0.047, 4
_ALIKE, _UNLIKE, _LEAST_ALIKE = 0.015, 4.0, 2.0


def find_highlights(reduced: ReducedPair, lamps: Lamps, flash_white: Floats64) -> Highlights | None:
    """pipeline.separation.find_highlights.find_highlights."""
    if len(lamps) != 2:
        return None
    colours = lamps.matrices @ flash_white
    weights, size = lamps.channel_weights, reduced.usable.shape
    seen, light = reduced.no_flash * weights, light_of_lamps(reduced.flash, lamps) * weights
    matt, left = _matt(reduced, lamps, seen, light)
    around, kind, worth = np.zeros((2, *size)), np.full(size, -1), np.full(size, -_MOST_WORTH)
    brighter = np.zeros(size)
    notable = (matt > _NOTABLE * _mean_around(matt, reduced.usable)).any(axis=0)
    for y, x in np.argwhere(reduced.usable & (notable | (left > _MODEL))):
        like, shares_there = _neighbours(reduced, matt, y, x)
        if like.sum() < _LEAST_ALIKE:
            continue
        s = np.array([_quantile(one, like, 0.5) for one in shares_there])
        around[:, y, x] = s
        of_matt = (left[y, x] / _MODEL) ** 2
        of_matt += _bounded(_off(matt[:, y, x], s) / _SHADING**2, _MOST_UNUSUAL)
        bright = np.array([_quantile(one, like, _BRIGHT) for one in shares_there])
        brighter[y, x] = _cost_of_brightness(matt[:, y, x], bright)
        of_kinds = [
            _cost_of_mirrored(seen[y, x], s @ light[:, y, x], mirrored * weights, s, bright)
            for mirrored in _mirrored(colours, s)
        ]
        if np.isfinite(min(of_kinds)):
            kind[y, x] = int(np.argmin(of_kinds))
            worth[y, x] = max(of_matt - min(of_kinds), -2 * _MOST_WORTH)
    bright_ones = worth[brighter > _MOST_BRIGHT / 2]
    mirrors, matts = (bright_ones > _WORTH).sum(), (bright_ones < -_WORTH).sum()
    trust = mirrors / (mirrors + matts) if mirrors + matts else 1.0
    worth = np.clip(worth + trust * brighter, -_MOST_WORTH, _MOST_WORTH)
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
    reduced: ReducedPair, lamps: Lamps, seen: Floats64, light: Floats64
) -> tuple[Floats64, Floats64]:
    """Shares (2, h, w) of matt light, and what they leave over of it, relative, less noise."""
    z = shares(seen, light).astype(np.float64)
    off = seen - np.einsum("nhw,nhwk->hwk", z, light)
    mixed = np.einsum("nhw,nkc->hwkc", z, lamps.matrices)
    variance = np.einsum("hwkc,hwc->hwk", np.square(mixed), reduced.flash_variance)
    variance = (variance + reduced.no_flash_variance) * np.square(lamps.channel_weights)
    left = np.maximum((np.square(off) - variance).sum(axis=2), 0.0)
    return z, np.sqrt(left / np.maximum(np.square(seen).sum(axis=2), 1e-12))


def _neighbours(reduced: ReducedPair, matt: Floats64, y: int, x: int) -> tuple[Floats64, Floats64]:
    """How like a block those around it are (n,), and their shares (2, n)."""
    rows, columns = (
        [
            i
            for i in middle + _step(reduced.usable) * np.arange(-_STEPS, _STEPS + 1)
            if 0 <= i < size
        ]
        for middle, size in zip((y, x), reduced.usable.shape, strict=True)
    )
    near = np.ix_(rows, columns)
    usable = reduced.usable[near]
    flash = reduced.flash[near][usable].astype(np.float64)
    off = _chromaticity(flash) - _chromaticity(reduced.flash[y, x].astype(np.float64))
    off = np.square(off).sum(axis=-1) / _ALIKE**2
    like = np.where(off < _UNLIKE**2, np.exp(-off / 2), 0.0)
    return like, np.array([one[near][usable] for one in matt])


def _mean_around(matt: Floats64, usable: NDArray[np.bool_]) -> Floats64:
    side = 2 * _STEPS * _step(usable) + 1
    count = np.maximum(_mean(usable.astype(np.float64), side), 1e-12)
    return np.stack([_mean(one * usable, side) / count for one in matt])


def _step(usable: NDArray[np.bool_]) -> int:
    height, width = usable.shape
    return int(max(round(_REACH * max(height, width) / _STEPS), 1))


def _off(z: Floats64, s: Floats64) -> float:
    """How far shares (2,) are from others, relative to these, squared."""
    return float(np.square((z - s) / (s + _LEAST_SHADING * s.sum() + 1e-12)).sum())


def _cost_of_brightness(z: Floats64, bright: Floats64) -> float:
    beyond = _off(np.maximum(z, bright), bright)
    return _bounded(beyond / _BRIGHTER**2, _MOST_BRIGHT)


def _cost_of_mirrored(
    seen: Floats64, matt: Floats64, mirrored: Floats64, s: Floats64, bright: Floats64
) -> float:
    """How far weighed light (3,) is from the highlight; infinite where nothing is mirrored."""
    a, b = _explain(seen, matt, mirrored)
    if not b > 0:
        return np.inf
    left = np.square(seen - a * matt - b * mirrored).sum()
    whole = max(np.square(seen).sum(), 1e-12)
    unusual = float(np.square((a - 1.0) / _SHADING))
    cost = float(left / whole / _MODEL**2 + _bounded(unusual, _MOST_UNUSUAL))
    return cost + _cost_of_brightness(a * s, bright)


def _explain(seen: Floats64, matt: Floats64, mirrored: Floats64) -> Floats64:
    """How often matt and mirrored light (…, 3) are in what is seen, (2, …).

    Least squares with a fourth equation: that matt light is there once, to _SHADING of it, as light
    is that of the model to _MODEL.
    """
    whole = np.maximum(np.square(seen).sum(axis=-1, keepdims=True), 1e-12)
    once = _MODEL / _SHADING * np.sqrt(whole)
    seen, matt = (np.concatenate([one, once], axis=-1) for one in (seen, matt))
    mirrored = np.concatenate([mirrored, np.zeros_like(once)], axis=-1)
    return shares(seen, np.stack([matt, mirrored])).astype(np.float64)


def _mirrored(colours: Floats64, s: Floats64) -> tuple[Floats64, Floats64, Floats64]:
    """Light of the first lamp, of the second, and what the flash's part pretends, (…, 3)."""
    return colours[0], colours[1], -np.einsum("n...,nk->...k", s, colours)


def _bounded(squared: float, most: float) -> float:
    return most * squared / (most + squared)


def _quantile(values: Floats64, weights: Floats64, part: float) -> float:
    """The least value with that part of the weight at or below it."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, part * weights.sum())])


def _chromaticity(flash: Floats64) -> Floats64:
    return np.asarray(flash[..., :2] / np.maximum(flash.sum(axis=-1, keepdims=True), 1e-12))


def _mean(values: Floats64, side: int) -> Floats64:
    """Mean over side × side blocks around each, mirrored at the border."""
    wide = np.pad(values, side // 2, mode="reflect")
    return np.asarray(sliding_window_view(wide, (side, side)).mean(axis=(2, 3)))


def deal_out(
    highlights: Highlights, no_flash: Image, flash: Image, lamps: Lamps, proportions: Image
) -> Image:
    """pipeline.separation.highlights.Highlights.deal_out, of a whole picture."""
    planes = enlarged(highlights.blocks, highlights.side, flash.shape[:2])
    weights, s, c = planes[:3, ..., None], planes[3:], highlights.colours
    matt = s[..., None] * light_of_lamps(flash, lamps)
    channels = lamps.channel_weights
    lamp_or_not = np.array([[1, 0], [0, 1], [0, 0]])
    out = proportions.astype(np.float64)
    for kind, mirrored in enumerate(_mirrored(c, s)):
        mirrored = np.broadcast_to(mirrored, flash.shape)
        a, b = _explain(no_flash * channels, matt.sum(axis=0) * channels, mirrored * channels)
        a, b = a[..., None], b[..., None]
        of_lamps = lamp_or_not[kind][:, None, None] if kind < 2 else -s
        light = np.maximum(a * matt + b * of_lamps[..., None] * c[:, None, None], 0.0)
        total = light.sum(axis=0)
        dealt = np.where(total > 0, light / np.where(total > 0, total, 1.0), proportions)
        out += weights[kind] * (dealt - proportions)
    return out.astype(np.float32)


def enlarged(blocks: Image, side: int, size: tuple[int, int]) -> Floats64:
    """pipeline.images.enlarge.enlarge: planes (P, H, W), linear between the middles of blocks."""
    planes = np.moveaxis(blocks, 2, 0).astype(np.float64)
    for axis in (1, 2):
        place = (np.arange(size[axis - 1]) + 0.5) / side - 0.5
        known = np.arange(planes.shape[axis])
        planes = np.apply_along_axis(lambda line: np.interp(place, known, line), axis, planes)  # noqa: B023
    return planes
