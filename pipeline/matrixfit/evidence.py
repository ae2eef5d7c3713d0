"""What the pair says about its lamps: pixels, and differences across the edges of shadows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Mask
from pipeline.reduced import ReducedPair

Array = NDArray[np.float64]

_DIM_FLASH, _DARK = 0.01, 0.005  # of the 99th percentile
_MAX_NOISE = 0.04  # relative
_LEAST_SHARE = 0.3
_MIN_NOISE = 1.5e-4  # relative: no photograph is better
_SPACING = 256 / 3  # of the longer side: pixels compared lie 3 of 256 apart
_SAME_SURFACE, _SAME_SHADING = 0.006, 0.15
_MAX_DIFFERENCE_NOISE = 0.05
_MIN_COLOUR = -0.15
_BEYOND = 0.5  # change of light on both sides of a shadow's edge, of that across it
_PIXEL_WEIGHT, _DIFFERENCE_WEIGHT, _MANY_DIFFERENCES = 400.0, 250.0, 600.0
_AREA_WEIGHT, _SURFACE_WEIGHT = 60.0, 400.0  # people seldom find places of one lamp alone
_PIXELS, _DIFFERENCES = 3600, 3200
_LEAST_STEP = 0.25  # of the mean light relative to the flash
_FEW_DIFFERENCES = 0.003  # of the usable pixels
_CELL, _FLATTENING, _MIN_FLASH_COLOUR = 0.01, 0.6, 1e-3
_DIRECTIONS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2))


@dataclass(frozen=True)
class Data:
    """n chromaticities to be explained.

    x: (n, 3) flash colour, summing to 1. u: (n, 2) red and green chromaticity of the light.
    covariance: (n, 3) its xx, xy, yy. weight: (n,).
    """

    x: Array
    u: Array
    covariance: Array
    weight: Array

    def __len__(self) -> int:
        return len(self.weight)

    def thinned(self, count: int) -> Data:
        """Evenly drawn subset of at most so many, with the same total weight."""
        if len(self) <= count:
            return self
        pick = np.linspace(0, len(self) - 1, count).round().astype(int)
        scale = self.weight.sum() / self.weight[pick].sum()
        return Data(self.x[pick], self.u[pick], self.covariance[pick], self.weight[pick] * scale)


@dataclass(frozen=True)
class Evidence:
    """pixels and differences as Data; difference_share: differences accepted ÷ usable pixels."""

    pixels: Data
    differences: Data
    difference_share: float

    @property
    def has_edges(self) -> bool:
        """Whether the scene has edges of shadows; the few differences of others are chance."""
        return self.difference_share >= _FEW_DIFFERENCES


def gather_evidence(reduced: ReducedPair, flash_only: bool) -> Evidence:
    """Draw data from the reduced pair, deterministically.

    flash_only: the flash file was the flash part alone, so that its noise is independent.
    """
    no_flash, flash, v_n, v_f, coupled = _readings(reduced, flash_only)
    s_n, s_f = no_flash.sum(axis=2), flash.sum(axis=2)
    safe_n, safe_f = np.where(s_n > 0, s_n, 1.0), np.where(s_f > 0, s_f, 1.0)
    use = (
        reduced.usable
        & (s_f > _DIM_FLASH * np.percentile(s_f, 99))
        & (s_n > _DARK * np.percentile(s_n, 99))
    )
    noise = np.maximum(np.sqrt(v_n.sum(axis=2)) / safe_n, np.sqrt(v_f.sum(axis=2)) / safe_f)
    if use.any():  # of a very noisy pair, what is least noisy
        use &= noise <= max(_MAX_NOISE, float(np.quantile(noise[use], _LEAST_SHARE)))
    return Evidence(
        _pixels(no_flash[use], flash[use], v_n[use], v_f[use], coupled),
        *_differences(no_flash, flash, v_n, v_f, use, coupled),
    )


def evidence_of_area(reduced: ReducedPair, flash_only: bool, area: Mask) -> Data:
    """What the usable pixels of an area (h, w) show.

    flash_only: as gather_evidence takes it.
    """
    n, f, v_n, v_f, coupled = _readings(reduced, flash_only)
    use = area & reduced.usable
    data = _pixels(n[use], f[use], v_n[use], v_f[use], coupled)
    return replace(data, weight=data.weight * (_AREA_WEIGHT / _PIXEL_WEIGHT))


def evidence_of_surfaces(flash: Array, light: Array) -> Data:
    """What surfaces show under one lamp, exactly.

    flash, light: (m, 3) camera RGB of surfaces under the flash and under the lamp.
    """
    x, u = (a / a.sum(axis=1, keepdims=True) for a in (flash, light))
    weight = np.full(len(x), _SURFACE_WEIGHT / len(x))
    return Data(x, u[:, :2], np.zeros_like(x), weight)


def _readings(reduced: ReducedPair, flash_only: bool) -> tuple[Array, Array, Array, Array, float]:
    """No-flash photograph, flash part, their variances (h, w, 3), and how far they are coupled."""
    no_flash, flash = (a.astype(np.float64) for a in (reduced.no_flash, reduced.flash))
    s_n, s_f = no_flash.sum(axis=2), flash.sum(axis=2)
    v_n = np.maximum(reduced.no_flash_variance, (_MIN_NOISE * s_n[..., None]) ** 2)
    coupled = 0.0 if flash_only else 1.0
    v_f = np.maximum(reduced.flash_variance, (_MIN_NOISE * s_f[..., None]) ** 2 + coupled * v_n)
    return no_flash, flash, v_n, v_f, coupled


def _pixels(n: Array, f: Array, v_n: Array, v_f: Array, coupled: float) -> Data:
    s_n, s_f = n.sum(axis=1), f.sum(axis=1)
    pick = _draw(np.sqrt(s_n) * _rarity(n / s_n[:, None], f / s_f[:, None]), _PIXELS)
    n, f, v_n, v_f, s_n, s_f = (a[pick] for a in (n, f, v_n, v_f, s_n, s_f))
    x, u = f / s_f[:, None], n / s_n[:, None]
    m_u = np.eye(3) - u[:, :, None]
    m_x = np.eye(3) - x[:, :, None]
    c_u = _sandwich(m_u, v_n, m_u) / s_n[:, None, None] ** 2
    c_x = _sandwich(m_x, v_f, m_x) / s_f[:, None, None] ** 2
    c_ux = -coupled * _sandwich(m_u, v_n, m_x) / (s_n * s_f)[:, None, None]
    j = m_u * (u / np.maximum(x, 0.02))[:, None, :]
    cross = c_ux @ j.transpose(0, 2, 1)
    c = c_u + j @ c_x @ j.transpose(0, 2, 1) - cross - cross.transpose(0, 2, 1)
    weight = np.full(len(x), _PIXEL_WEIGHT / max(len(x), 1))
    return Data(x, u[:, :2], _upper(c), weight)


def _differences(
    n: Array,
    f: Array,
    v_n: Array,
    v_f: Array,
    use: NDArray[np.bool_],
    coupled: float,
) -> tuple[Data, float]:
    s_f = np.where(use, f.sum(axis=2), 1.0)
    c, y = f / s_f[..., None], n / s_f[..., None]
    r = np.sqrt(v_f.sum(axis=2)) / s_f
    total_y = y.sum(axis=2)
    step_size = _LEAST_STEP * float(total_y[use].mean()) if use.any() else 0.0
    # variance of y = N/s_f, whose own sum s_f is noisy, too
    wide = v_f.sum(axis=2)[..., None, None]
    e = (
        np.eye(3) * v_n[..., None, :]
        + y[..., :, None] * y[..., None, :] * wide
        + coupled * (y[..., :, None] * v_n[..., None, :] + v_n[..., :, None] * y[..., None, :])
    ) / s_f[..., None, None] ** 2
    stride = max(use.shape) / _SPACING
    parts: list[tuple[Array, ...]] = []
    for dx, dy in _DIRECTIONS:
        length = stride / np.hypot(dx, dy)
        ox, oy = round(dx * length), round(dy * length)
        a, b = _shifted(use.shape, ox, oy)
        good = use[a] & use[b]
        good &= np.abs(np.log(s_f[a] / s_f[b])) < _SAME_SHADING
        near = np.abs(c[a] - c[b]).max(axis=2) < _SAME_SURFACE + np.hypot(r[a], r[b])
        good &= near & (np.abs(total_y[a] - total_y[b]) > step_size)
        good &= _is_edge(total_y, use, ox, oy)
        if not good.any():
            continue
        d = y[a][good] - y[b][good]
        s = d.sum(axis=1)
        u = d / s[:, None]
        x = (c[a][good] + c[b][good]) / 2
        m_u = np.eye(3) - u[:, :, None]
        c_u = m_u @ (e[a][good] + e[b][good]) @ m_u.transpose(0, 2, 1) / s[:, None, None] ** 2
        m_x = np.eye(3) - x[:, :, None]
        mean_s = ((s_f[a] + s_f[b])[good] / 2)[:, None, None]
        c_x = _sandwich(m_x, (v_f[a] + v_f[b])[good] / 4, m_x) / mean_s**2
        j = m_u * (u / np.maximum(x, 0.02))[:, None, :]
        cov = c_u + j @ c_x @ j.transpose(0, 2, 1)
        ok = (np.sqrt(np.trace(cov, axis1=1, axis2=2) / 2) < _MAX_DIFFERENCE_NOISE) & (
            u.min(axis=1) > _MIN_COLOUR
        )
        worth = np.sqrt(np.abs(s) * mean_s[:, 0, 0])
        parts.append((x[ok], u[ok, :2], _upper(cov[ok]), worth[ok]))
    if not parts or not sum(len(part[3]) for part in parts):
        empty = np.zeros((0, 3))
        return Data(empty, np.zeros((0, 2)), empty, np.zeros(0)), 0.0
    x, u, cov, worth = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    pick = _draw(worth, _DIFFERENCES)
    total = _DIFFERENCE_WEIGHT * min(1.0, len(worth) / _MANY_DIFFERENCES)
    weight = np.full(len(pick), total / len(pick))
    return Data(x[pick], u[pick], cov[pick], weight), len(worth) / max(int(use.sum()), 1)


def _draw(worth: Array, count: int) -> NDArray[np.int64]:
    """Indices drawn with probability ∝ worth by systematic sampling, so always the same ones."""
    if len(worth) <= count:
        return np.arange(len(worth))
    ladder = np.cumsum(worth)
    rungs = (np.arange(count) + 0.5) / count * ladder[-1]
    return np.unique(np.searchsorted(ladder, rungs))


def _rarity(u: Array, x: Array) -> Array:
    """How rare a pixel's light is."""
    ratio = u / np.maximum(x, _MIN_FLASH_COLOUR)
    ratio = ratio / ratio.sum(axis=1, keepdims=True)
    _, cell, count = np.unique(
        np.floor(ratio[:, :2] / _CELL).astype(np.int64),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    return np.asarray(count[cell.ravel()].astype(np.float64) ** -_FLATTENING)


def _shifted(
    shape: tuple[int, ...], ox: int, oy: int
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Two views of an image, pixel by pixel (ox, oy) apart; ox ≥ 0."""
    height, width = shape
    rows = (slice(0, height - abs(oy)), slice(abs(oy), height))
    a_rows, b_rows = rows if oy >= 0 else rows[::-1]
    return (a_rows, slice(0, width - ox)), (b_rows, slice(ox, width))


def _is_edge(light: Array, use: NDArray[np.bool_], ox: int, oy: int) -> NDArray[np.bool_]:
    """Whether the light changes between two pixels (ox, oy) apart and hardly beyond them.

    Across the edge of a shadow one lamp changes; along a bent surface all of them do.
    """
    padded = np.pad(np.where(use, light, np.nan), ((abs(oy), abs(oy)), (ox, ox)), mode="edge")
    height, width = light.shape
    inner = (slice(abs(oy), abs(oy) + height), slice(ox, ox + width))

    def at(steps: int) -> Array:
        rows = slice(inner[0].start + steps * oy, inner[0].stop + steps * oy)
        columns = slice(inner[1].start + steps * ox, inner[1].stop + steps * ox)
        return padded[rows, columns]

    before, after = np.abs(at(-1) - light), np.abs(at(1) - light)
    a, b = _shifted(use.shape, ox, oy)
    # what lies outside or cannot be used says nothing
    beyond = np.nan_to_num(before[a]) + np.nan_to_num(after[b])
    return np.asarray(beyond < _BEYOND * np.abs(light[a] - light[b]))


def _sandwich(left: Array, variance: Array, right: Array) -> Array:
    return np.asarray((left * variance[:, None, :]) @ right.transpose(0, 2, 1))


def _upper(covariance: Array) -> Array:
    return np.stack([covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]], axis=1)
