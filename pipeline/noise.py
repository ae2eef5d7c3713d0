"""How noisy a photograph is, and a filter that knows it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Image

_BINS = 24
_BLOCK = 8
_SCALES = (1, 2, 4)
_SMALLEST, _SPARSE = 32, 8
_WINDOWS = ((2, 1), (1, 3), (1, 6), (1, 12))  # reach and gap of each round
_JOIN = 4.2  # standard deviations of one pixel, over six channels
HALO = sum(reach * gap for reach, gap in _WINDOWS)
"""Rows that sigma_filter needs beyond either end of a strip."""


@dataclass(frozen=True)
class Noise:
    """Variance of a photograph's values: gain·I + floor, one of each per channel.

    gain, floor: float64 (3,), linear camera RGB units. grain: area in pixels over which the noise
    hangs together, 1 for a bare sensor, more after demosaicing, denoising and compression.
    """

    gain: NDArray[np.float64]
    floor: NDArray[np.float64]
    grain: float = 1.0

    def variance(
        self, pixels: NDArray[np.floating], averaged: float | NDArray[np.floating] = 1.0
    ) -> NDArray[np.float64]:
        """Variance of values (..., 3), or of means of so many neighbouring pixels."""
        single = self.gain * np.maximum(pixels, 0.0) + self.floor
        return np.asarray(single * np.minimum(1.0, self.grain / averaged))

    def of_means(self, block: int) -> Noise:
        """The noise of means over block × block pixels."""
        less = min(1.0, self.grain / block**2)
        return Noise(self.gain * less, self.floor * less, max(self.grain / block**2, 1.0))

    def stabilize(self, pixels: Image) -> Image:
        """Transform values so that their noise has unit variance everywhere, (..., 3)."""
        gain = np.maximum(self.gain, 1e-9).astype(np.float32)
        floor = np.maximum(self.floor, 1e-12).astype(np.float32)
        return np.asarray(2.0 / gain * np.sqrt(gain * np.maximum(pixels, 0.0) + floor))


def estimate_noise(pixels: Image) -> Noise:
    """Estimate the noise of a photograph from its own flat areas.

    pixels: (H, W, 3) linear. Second differences (Immerkær 1996) give a variance per block; a
    straight line over brightness is fitted to the quieter blocks, because the busier ones hold
    texture. Done on the photograph and on means of 2×2 and 4×4 pixels, since denoising and
    compression leave noise that hides from neighbouring pixels; smaller than 64 pixels, once.
    """
    height, width = pixels.shape[:2]
    scales = [s for s in _SCALES if min(height, width) >= _SMALLEST * s] or [1]
    fits = [_fit(_shrunk(pixels, scale)) for scale in scales]
    typical = np.median(pixels[::_SPARSE, ::_SPARSE].reshape(-1, 3), axis=0)
    levels = [float((gain * np.maximum(typical, 0) + floor).sum()) for gain, floor in fits]
    loudest = int(np.argmax(levels[:2]))
    grain = max(
        scale**2 * level / levels[loudest] for scale, level in zip(scales, levels, strict=True)
    )
    return Noise(*fits[loudest], grain=max(grain, 1.0))


def _shrunk(pixels: Image, scale: int) -> Image:
    if scale == 1:
        return pixels
    size = (pixels.shape[1] // scale, pixels.shape[0] // scale)
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _fit(pixels: Image) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gain and floor of each channel."""
    step = max(1, pixels.shape[0] * pixels.shape[1] // 4_000_000)
    tops = range(0, len(pixels) - _BLOCK + 1, _BLOCK * step)
    kernel = np.outer([1, -2, 1], [1, -2, 1]).astype(np.float32) / 6.0
    gains, floors = np.empty(3), np.empty(3)
    for channel in range(3):
        means, variances = [], []
        for top in tops:
            plane = np.ascontiguousarray(pixels[top : top + _BLOCK, :, channel])
            width = plane.shape[1] // _BLOCK * _BLOCK
            detail = cv2.filter2D(plane, -1, kernel, borderType=cv2.BORDER_REFLECT_101)
            blocks = (np.square(detail[1:-1, :width])).reshape(_BLOCK - 2, -1, _BLOCK)
            variances.append(blocks.mean(axis=(0, 2)))
            means.append(plane[:, :width].reshape(_BLOCK, -1, _BLOCK).mean(axis=(0, 2)))
        gains[channel], floors[channel] = _fit_line(
            np.concatenate(means), np.concatenate(variances)
        )
    return gains, floors


def _fit_line(means: NDArray[np.floating], variances: NDArray[np.floating]) -> tuple[float, float]:
    """Non-negative gain and floor through the lower quartiles of variance per brightness bin."""
    order = np.argsort(means)
    bins = np.array_split(order, _BINS)
    x = np.array([means[b].mean() for b in bins if len(b)])
    y = np.array([np.quantile(variances[b], 0.25) for b in bins if len(b)])
    weight = 1.0 / (y + 1e-3 * y.max() + 1e-14)
    matrix = np.column_stack([x, np.ones_like(x)]) * weight[:, None]
    gain, floor = np.linalg.lstsq(matrix, y * weight, rcond=None)[0]
    if gain < 0:
        gain, floor = 0.0, float(np.average(y, weights=weight))
    if floor < 0:
        floor, gain = (
            0.0,
            float(np.average(y, weights=weight) / max(np.average(x, weights=weight), 1e-9)),
        )
    return max(float(gain), 1e-8), max(float(floor), 1e-11)


def sigma_filter(
    images: tuple[Image, Image], noises: tuple[Noise, Noise], keep: slice = slice(None)
) -> tuple[Image, Image, NDArray[np.float32]]:
    """Average each pixel of a pair with the neighbours that differ from it only by noise.

    A neighbour joins when the six channels' squared differences, each divided by the variance
    of one pixel, sum to less than 4.2² (Lee, "Digital image smoothing and the sigma filter",
    1983, on the pair). First the 5×5 window, then 3×3 windows with ever wider gaps on what came
    out, so that flat areas are averaged widely at little cost (à trous, Holschneider et al. 1989).

    Parameters
    ----------
    images : two (h, W, 3) photographs, independent of each other
    noises : the noise of each
    keep : the rows to return; the others, HALO on either side or up to the border, are halo

    Returns
    -------
    two (len(keep), W, 3) filtered photographs, and (len(keep), W) how many pixels were averaged
    """
    values = np.concatenate(images, axis=2)
    certainty = np.ones(values.shape[:2], dtype=np.float32)  # pixels averaged so far
    for reach, gap in _WINDOWS:
        values, certainty = _join(values, certainty, noises, reach, gap)
    values = values[keep]
    first, second = (np.ascontiguousarray(values[..., part]) for part in (slice(3), slice(3, 6)))
    return first, second, certainty[keep]


def _join(
    values: Image, certainty: Image, noises: tuple[Noise, Noise], reach: int, gap: int
) -> tuple[Image, Image]:
    """One round of the filter on (h, W, 6): neighbours at −reach … reach gaps in both axes."""
    stable = np.concatenate(
        [noise.stabilize(values[..., 3 * i : 3 * i + 3]) for i, noise in enumerate(noises)], axis=2
    ).transpose(2, 0, 1)
    height, width = certainty.shape
    edge = reach * gap
    pad = ((0, 0), (edge, edge), (edge, edge))
    center = np.ascontiguousarray(stable)
    around = np.pad(center, pad, constant_values=np.inf)  # what lies outside never joins
    planes = np.pad(values.transpose(2, 0, 1), pad)
    weights = np.pad(certainty, pad[1:], constant_values=1.0)
    total = planes[:, edge : edge + height, edge : edge + width] * certainty
    count = certainty.copy()
    limit = np.float32(_JOIN**2)
    distance, scratch = np.empty_like(count), np.empty_like(count)
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if dy == dx == 0:
                continue
            ys = slice(edge + dy * gap, edge + dy * gap + height)
            xs = slice(edge + dx * gap, edge + dx * gap + width)
            distance.fill(0.0)
            for channel in range(6):
                np.subtract(center[channel], around[channel, ys, xs], out=scratch)
                np.multiply(scratch, scratch, out=scratch)
                np.add(distance, scratch, out=distance)
            joins = np.where(distance < limit, weights[ys, xs], np.float32(0.0))
            count += joins
            for channel in range(6):
                np.multiply(joins, planes[channel, ys, xs], out=scratch)
                total[channel] += scratch
    total /= count
    return np.ascontiguousarray(total.transpose(1, 2, 0)), count
