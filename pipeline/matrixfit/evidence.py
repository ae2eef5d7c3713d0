"""What the pair says about its lamps: pixels, edges of shadows, terminators, pools of light."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

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
from pipeline.matrixfit.contrasts import RelativeLight, drawn, relative_light
from pipeline.matrixfit.differences import find_differences
from pipeline.matrixfit.pools import find_pools
from pipeline.matrixfit.terminators import find_terminators
from pipeline.pair.reduced import ReducedPair

# Chosen on development scenes (docs/decisions/0005-fitted-lamps.md)
_DIM_FLASH, _DARK = 0.01, 0.005  # of the 99th percentile
_MAX_NOISE = 0.04  # relative
_LEAST_SHARE = 0.3  # of the pixels, that is kept however noisy they are
_MIN_NOISE = 1.5e-4  # relative: no photograph is better
_PIXEL_WEIGHT = 400.0  # of all pixels together, as of _AREA_WEIGHT and _SURFACE_WEIGHT
_AREA_WEIGHT, _SURFACE_WEIGHT = 60.0, 400.0  # people seldom find places of one lamp alone
_PIXELS, _DIFFERENCES, _TERMINATORS, _POOLS = 3600, 3200, 1600, 1600  # drawn at most
_FEW_DIFFERENCES, _FEW_TERMINATORS, _FEW_POOLS = 0.003, 0.001, 0.05  # of the usable pixels
_CELL, _FLATTENING = 0.01, 0.6  # of chromaticities ÷ the flash's; power of a cell's count
_MIN_FLASH_COLOUR = 1e-3


@dataclass(frozen=True)
class Evidence:
    """What pixels show, differences across the edges of shadows, terminators, and pools of light.

    difference_share, terminator_share: how many there were ÷ usable pixels. Where shadows have
    edges, terminators are not asked, and their share is 0. Pools are not asked where there are
    terminators, nor beside edges in a photograph that a camera rendered.
    """

    pixels: Chromaticities
    differences: Chromaticities
    terminators: Chromaticities
    pools: Chromaticities
    difference_share: float
    terminator_share: float

    @property
    def has_edges(self) -> bool:
        """Whether the scene has edges of shadows; the few differences of others are chance."""
        return self.difference_share >= _FEW_DIFFERENCES

    @property
    def surest(self) -> Evidence:
        """The part that lamps are counted and first found by: all but pools beside shadow edges."""
        return replace(self, pools=nothing()) if self.has_edges else self


def gather_evidence(reduced: ReducedPair) -> Evidence:
    """Draw data from the reduced pair, deterministically."""
    readings = _readings(reduced)
    ratios = _readable_light(reduced, readings)
    usable = max(int(ratios.use.sum()), 1)
    differences, terminators = find_differences(ratios), find_terminators(ratios)
    difference_share, terminator_share = _count(differences) / usable, _count(terminators) / usable
    has_edges = difference_share >= _FEW_DIFFERENCES
    # few are chance, and where shadows have edges, soft ones have bends of all lamps beside them
    if terminator_share < _FEW_TERMINATORS or has_edges:
        terminators, terminator_share = [], 0.0
    # terminators are surer, and light that bounces off round things bends on the floor; so are
    # edges where a camera's rendering bends what is straight
    surer = terminator_share > 0 or (has_edges and reduced.rendered)
    pools = [] if surer else find_pools(ratios)
    # few are chance, where there is no wall; beside edges they only say little
    if not has_edges and _count(pools) < _FEW_POOLS * usable:
        pools = []
    return Evidence(
        _pixels(readings, ratios.use),
        drawn(differences, _DIFFERENCES),
        drawn(terminators, _TERMINATORS),
        drawn(pools, _POOLS),
        difference_share,
        terminator_share,
    )


def readable_light(reduced: ReducedPair) -> RelativeLight:
    """Light relative to the flash, of the pixels that tell something of lamps.

    These are usable, neither dark nor under hardly any flash, and not too noisy.
    """
    return _readable_light(reduced, _readings(reduced))


def _readable_light(reduced: ReducedPair, readings: _Readings) -> RelativeLight:
    no_flash, flash = readings.no_flash, readings.flash
    v_n, v_f = readings.no_flash_variance, readings.flash_variance
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
    return relative_light(no_flash, flash, v_n, v_f, use, readings.coupled)


def _count(parts: list[Chromaticities]) -> int:
    return sum(len(part) for part in parts)


def evidence_of_area(reduced: ReducedPair, area: Mask) -> Chromaticities:
    """What the usable pixels of an area (h, w) show."""
    data = _pixels(_readings(reduced), area & reduced.usable)
    return replace(data, weight=data.weight * (_AREA_WEIGHT / _PIXEL_WEIGHT))


def evidence_of_surfaces(flash: Floats64, light: Floats64) -> Chromaticities:
    """What surfaces show under one lamp, exactly.

    flash, light: (m, 3) camera RGB of surfaces under the flash and under the lamp; those that
    either leaves dark have no colour, and are left out.
    """
    lit = (flash.sum(axis=1) > 0) & (light.sum(axis=1) > 0)
    flash, light = flash[lit], light[lit]
    x, u = (a / a.sum(axis=1, keepdims=True) for a in (flash, light))
    weight = np.full(len(x), _SURFACE_WEIGHT / max(len(x), 1))
    return Chromaticities(x, u[:, :2], np.zeros_like(x), weight)


@dataclass(frozen=True)
class _Readings:
    """A reduced pair in double precision, its noise no less than that of the best photograph.

    no_flash, flash, no_flash_variance, flash_variance: (h, w, 3), as in ReducedPair. coupled: 1
    where the flash part is a difference, which has the no-flash photograph's noise as well, 0 where
    it was given alone: the covariance of both is −coupled · no_flash_variance.
    """

    no_flash: Floats64
    flash: Floats64
    no_flash_variance: Floats64
    flash_variance: Floats64
    coupled: float


def _readings(reduced: ReducedPair) -> _Readings:
    no_flash, flash = (a.astype(np.float64) for a in (reduced.no_flash, reduced.flash))
    s_n, s_f = no_flash.sum(axis=2), flash.sum(axis=2)
    v_n = np.maximum(reduced.no_flash_variance, (_MIN_NOISE * s_n[..., None]) ** 2)
    coupled = 0.0 if reduced.flash_only else 1.0
    v_f = np.maximum(reduced.flash_variance, (_MIN_NOISE * s_f[..., None]) ** 2 + coupled * v_n)
    return _Readings(no_flash, flash, v_n, v_f, coupled)


def _pixels(readings: _Readings, use: Mask) -> Chromaticities:
    """What pixels (h, w) show, rare light more often; the covariance is that of u − u(x).

    u is the light's chromaticity and x the flash part's, by which a lamp's u changes (by_colour).
    """
    n, f, v_n, v_f = (
        image[use]
        for image in (
            readings.no_flash,
            readings.flash,
            readings.no_flash_variance,
            readings.flash_variance,
        )
    )
    s_n, s_f = n.sum(axis=1), f.sum(axis=1)
    pick = draw(np.sqrt(s_n) * _rarity(n / s_n[:, None], f / s_f[:, None]), _PIXELS)
    n, f, v_n, v_f, s_n, s_f = (a[pick] for a in (n, f, v_n, v_f, s_n, s_f))
    x, u = f / s_f[:, None], n / s_n[:, None]
    m_u = np.eye(3) - u[:, :, None]
    m_x = np.eye(3) - x[:, :, None]
    c_u = sandwich(m_u, v_n, m_u) / s_n[:, None, None] ** 2
    c_x = sandwich(m_x, v_f, m_x) / s_f[:, None, None] ** 2
    c_ux = -readings.coupled * sandwich(m_u, v_n, m_x) / (s_n * s_f)[:, None, None]
    j = by_colour(m_u, u, x)
    cross = c_ux @ j.transpose(0, 2, 1)
    c = c_u + j @ c_x @ j.transpose(0, 2, 1) - cross - cross.transpose(0, 2, 1)
    weight = np.full(len(x), _PIXEL_WEIGHT / max(len(x), 1))
    return Chromaticities(x, u[:, :2], upper(c), weight)


def _rarity(u: Floats64, x: Floats64) -> Floats64:
    """Weights (n,) of pixels of light u under flash colour x, (n, 3): the rarer, the more."""
    ratio = u / np.maximum(x, _MIN_FLASH_COLOUR)
    ratio = ratio / ratio.sum(axis=1, keepdims=True)
    row, column = np.floor(ratio[:, :2] / _CELL).astype(np.int64).T
    # one number for each cell: whole rows are compared ten times as slowly
    _, cell, count = np.unique(
        row * round(2.0 / _CELL) + column, return_inverse=True, return_counts=True
    )
    return np.asarray(count[cell].astype(np.float64) ** -_FLATTENING)
