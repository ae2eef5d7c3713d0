"""Light relative to the flash, and contrasts of it: sums over neighbours that even light cancels.

What is left of a contrast is the light of the lamps that change there, on one surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.images.frames import Mask
from pipeline.matrixfit.chromaticities import (
    Chromaticities,
    by_colour,
    draw,
    nothing,
    sandwich,
    upper,
)

Places = tuple[NDArray[np.intp], NDArray[np.intp]]

MANY = 600
"""Contrasts of one kind that count in full; fewer are chance, and noise."""

_DIRECTIONS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2))
_SPACING = 256 / 3  # of the longer side: pixels compared lie 3 of 256 apart
# Chosen on development scenes (docs/decisions/0005-fitted-lamps.md)
_SAME_SURFACE = 0.006  # chromaticity under the flash, beyond its noise
_MAX_NOISE = 0.05  # standard deviation of a contrast's chromaticity
_MIN_COLOUR = -0.15  # chromaticity; what is below is no lamp's
_WEIGHT = 250.0  # of all data of a kind together, where there are many


@dataclass(frozen=True)
class RelativeLight:
    """Light over the strength of the flash, pixel by pixel.

    use: bool (h, w), the pixels that count; elsewhere nothing is meant. strength: (h, w) sum of
    the flash part. colour: (h, w, 3) flash colour, summing to 1. light: (h, w, 3) no-flash light ÷
    strength. total: (h, w) its sum. noise: (h, w) relative deviation of the strength.
    light_variance, flash_variance: (h, w, 3) of the photograph and of the flash part. coupled: 1
    where the flash part is a difference with the photograph, else 0.
    """

    use: Mask
    strength: Floats64
    colour: Floats64
    light: Floats64
    total: Floats64
    noise: Floats64
    light_variance: Floats64
    flash_variance: Floats64
    coupled: float

    def alike(self, a: Places, b: Places) -> Mask:
        """Whether the flash shows surfaces of one colour at two lists of n places each, (n,)."""
        apart = np.abs(self.colour[a] - self.colour[b]).max(axis=-1)
        return np.asarray(apart < _SAME_SURFACE + np.hypot(self.noise[a], self.noise[b]))

    def covariance(self, at: Places) -> Floats64:
        """Covariance (..., 3, 3) of the light at places; the strength's own noise is in it."""
        y, v_n = self.light[at], self.light_variance[at]
        wide = self.flash_variance[at].sum(axis=-1)[..., None, None]
        shared = y[..., :, None] * v_n[..., None, :] + v_n[..., :, None] * y[..., None, :]
        spread = np.eye(3) * v_n[..., None, :] + y[..., :, None] * y[..., None, :] * wide
        return np.asarray(
            (spread + self.coupled * shared) / self.strength[at][..., None, None] ** 2
        )


def relative_light(
    no_flash: Floats64, flash: Floats64, v_n: Floats64, v_f: Floats64, use: Mask, coupled: float
) -> RelativeLight:
    """Light of a no-flash photograph relative to a flash part, (h, w, 3), with their variances."""
    strength = np.where(use, flash.sum(axis=2), 1.0)
    light = no_flash / strength[..., None]
    return RelativeLight(
        use=use,
        strength=strength,
        colour=flash / strength[..., None],
        light=light,
        total=light.sum(axis=2),
        noise=np.sqrt(v_f.sum(axis=2)) / strength,
        light_variance=v_n,
        flash_variance=v_f,
        coupled=coupled,
    )


def steps(shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """Steps (dx, dy) in pixels between neighbours, of like length in six directions; dx ≥ 0.

    shape: (h, w). Directions are left out in which nothing has a neighbour.
    """
    height, width = shape
    stride = max(shape) / _SPACING
    lengths = [stride / np.hypot(dx, dy) for dx, dy in _DIRECTIONS]
    every = [
        (round(dx * length), round(dy * length))
        for (dx, dy), length in zip(_DIRECTIONS, lengths, strict=True)
    ]
    return [(dx, dy) for dx, dy in every if dx < width and abs(dy) < height]


def along(shape: tuple[int, ...], ox: int, oy: int, reach: int) -> list[tuple[slice, slice]]:
    """Views of an image, each (ox, oy) pixels from the one before; ox ≥ 0.

    shape: (h, w). There are 2 · reach + 1, the middle one of the pixels that have so many
    neighbours on both sides, whose first is reach · (|oy|, ox). None where no pixel has.
    """
    height, width = shape
    top, left = reach * abs(oy), reach * ox
    if height <= 2 * top or width <= 2 * left:
        return []
    corners = [(top + k * oy, left + k * ox) for k in range(-reach, reach + 1)]
    return [(slice(y, y + height - 2 * top), slice(x, x + width - 2 * left)) for y, x in corners]


def contrast(
    ratios: RelativeLight,
    at: Places,
    factors: Floats64,
    surface: Floats64,
    significance: float = 0.0,
) -> Chromaticities:
    """Chromaticities of contrasts, Σ_k factors_k · light_k over the places of each.

    Left out are those that are too noisy, not above 0, or no colour of a light. The weight is what
    `drawn` draws them by: √(their sum · the strength of the flash there).

    Parameters
    ----------
    at : rows and columns (n, k) of the places in each contrast
    factors : (k,) what light is multiplied by there, summing to 0
    surface : (k,) shares of the places in the flash colour, summing to 1
    significance : how many standard deviations the sum of the channels must be above 0
    """
    d = np.einsum("k,nkc->nc", factors, ratios.light[at])
    e = np.einsum("k,nkij->nij", factors**2, ratios.covariance(at))
    s = d.sum(axis=1)
    clear = s > significance * np.sqrt(np.maximum(e.sum(axis=(1, 2)), 0.0))
    d, e, s, at = d[clear], e[clear], s[clear], (at[0][clear], at[1][clear])
    x = np.einsum("k,nkc->nc", surface, ratios.colour[at])
    strength = ratios.strength[at] @ surface
    u = d / s[:, None]
    m_u, m_x = np.eye(3) - u[:, :, None], np.eye(3) - x[:, :, None]
    c_u = m_u @ e @ m_u.transpose(0, 2, 1) / s[:, None, None] ** 2
    variance = np.einsum("k,nkc->nc", surface**2, ratios.flash_variance[at])
    c_x = sandwich(m_x, variance, m_x) / strength[:, None, None] ** 2
    j = by_colour(m_u, u, x)
    covariance = c_u + j @ c_x @ j.transpose(0, 2, 1)
    sure = np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 2) < _MAX_NOISE
    ok = sure & (u.min(axis=1) > _MIN_COLOUR)
    worth = np.sqrt(s * strength)
    return Chromaticities(x[ok], u[ok, :2], upper(covariance[ok]), worth[ok])


def drawn(parts: list[Chromaticities], count: int) -> Chromaticities:
    """At most so many of all contrasts, drawn by their worth.

    The weight of all together grows with how many there were, to a limit.
    """
    found = sum(len(part) for part in parts)
    if not found:
        return nothing()
    x, u, covariance, worth = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("x", "u", "covariance", "weight")
    )
    pick = draw(worth, count)
    total = _WEIGHT * min(1.0, found / MANY)
    return Chromaticities(x[pick], u[pick], covariance[pick], np.full(len(pick), total / len(pick)))
