"""How noisy a photograph is, and a filter that knows it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Image

_BINS = 24
_BLOCK = 8
_RADIUS = 2
_JOIN = 3.6  # standard deviations, over six channels
HALO = _RADIUS
"""Rows that sigma_filter needs beyond either end of a strip."""


@dataclass(frozen=True)
class Noise:
    """Variance of a photograph's values: gain·I + floor, one of each per channel.

    gain, floor: float64 (3,), linear camera RGB units.
    """

    gain: NDArray[np.float64]
    floor: NDArray[np.float64]

    def variance(self, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
        """Variance of each value, (..., 3) → (..., 3)."""
        return np.asarray(self.gain * np.maximum(pixels, 0.0) + self.floor)

    def stabilize(self, pixels: Image) -> Image:
        """Transform values so that their noise has unit variance everywhere, (..., 3)."""
        gain = np.maximum(self.gain, 1e-9).astype(np.float32)
        floor = np.maximum(self.floor, 1e-12).astype(np.float32)
        return np.asarray(2.0 / gain * np.sqrt(gain * np.maximum(pixels, 0.0) + floor))


def estimate_noise(pixels: Image) -> Noise:
    """Estimate the noise of a photograph from its own flat areas.

    pixels: (H, W, 3) linear, at least 32 × 32. Second differences (Immerkær 1996) give a variance
    per block; a straight line over brightness is fitted to the quieter blocks, because the
    busier ones hold texture.
    """
    step = max(1, pixels.shape[0] * pixels.shape[1] // 4_000_000)
    rows = [pixels[top : top + _BLOCK] for top in range(0, len(pixels) - _BLOCK + 1, _BLOCK * step)]
    gains, floors = np.empty(3), np.empty(3)
    kernel = np.outer([1, -2, 1], [1, -2, 1]).astype(np.float32) / 6.0
    for channel in range(3):
        means, variances = [], []
        for strip in rows:
            plane = np.ascontiguousarray(strip[..., channel])
            width = plane.shape[1] // _BLOCK * _BLOCK
            detail = cv2.filter2D(plane, -1, kernel, borderType=cv2.BORDER_REFLECT_101)
            blocks = (np.square(detail[1:-1, :width])).reshape(_BLOCK - 2, -1, _BLOCK)
            variances.append(blocks.mean(axis=(0, 2)))
            means.append(plane[:, :width].reshape(_BLOCK, -1, _BLOCK).mean(axis=(0, 2)))
        gains[channel], floors[channel] = _fit_line(
            np.concatenate(means), np.concatenate(variances)
        )
    return Noise(gains, floors)


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
    images: tuple[Image, Image], noises: tuple[Noise, Noise], keep: slice
) -> tuple[Image, Image]:
    """Average each pixel of a pair with the neighbours that differ from it only by noise.

    A neighbour in the 5×5 window joins when the six channels' squared differences, each divided
    by its variance, sum to less than 3.6² (Lee, "Digital image smoothing and the sigma filter",
    1983, on the pair).

    Parameters
    ----------
    images : two (h, W, 3) photographs, independent of each other
    noises : the noise of each
    keep : the rows to return; the others are halo

    Returns
    -------
    two (len(keep), W, 3) filtered photographs
    """
    stable = np.concatenate(
        [noise.stabilize(image) for image, noise in zip(images, noises, strict=True)], axis=2
    ).transpose(2, 0, 1)
    values = np.concatenate(images, axis=2).transpose(2, 0, 1)
    height, width = values.shape[1:]
    top, bottom, _ = keep.indices(height)
    rows = bottom - top
    total = np.ascontiguousarray(values[:, top:bottom])
    count = np.ones((rows, width), dtype=np.float32)
    center = np.ascontiguousarray(stable[:, top:bottom])
    pad = ((0, 0), (_RADIUS, _RADIUS), (_RADIUS, _RADIUS))
    stable = np.pad(stable, pad, constant_values=np.inf)  # what lies outside never joins
    values = np.pad(values, pad)
    distance = np.empty((rows, width), dtype=np.float32)
    scratch = np.empty((rows, width), dtype=np.float32)
    for dy in range(-_RADIUS, _RADIUS + 1):
        for dx in range(-_RADIUS, _RADIUS + 1):
            if dy == dx == 0:
                continue
            ys = slice(top + _RADIUS + dy, bottom + _RADIUS + dy)
            xs = slice(_RADIUS + dx, _RADIUS + dx + width)
            distance.fill(0.0)
            for channel in range(6):
                np.subtract(center[channel], stable[channel, ys, xs], out=scratch)
                np.multiply(scratch, scratch, out=scratch)
                np.add(distance, scratch, out=distance)
            joins = (distance < 2.0 * _JOIN**2).astype(np.float32)
            count += joins
            for channel in range(6):
                np.multiply(joins, values[channel, ys, xs], out=scratch)
                total[channel] += scratch
    total /= count
    smooth = np.ascontiguousarray(total.transpose(1, 2, 0))
    return smooth[..., :3], smooth[..., 3:]
