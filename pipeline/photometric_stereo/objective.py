"""How well a surface and its lamps explain a pair: −2 log posterior, and a Gauss–Newton step on it.

Four parts, robust but for the second: the light of every pixel; how far lamps and materials leave
what is usual; the albedo of a segment, which is even but for what chromaticity tells; bends of the
surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.photometric_stereo.equations import Rows
from pipeline.photometric_stereo.scene import (
    Scene,
    State,
    brightness,
    directions,
    directions_by_turns,
    facing,
    predicted,
    responses,
)

_FREEDOM = 9.0  # squared standard deviations beyond which a pixel's light counts less
_SHADOW = 5.0  # −2 log of how likely a lamp that a pixel faces does not shine there
_FLOOR = 0.002  # of the 99th percentile of the light
_ALBEDO_FREEDOM = 4.0  # the same of log albedo
_ALBEDO_FLOOR = 0.01  # least standard deviation of log albedo
_ALBEDO_SCALE = 0.02  # scale of the light beyond which albedo may be as far off
_TINT_SLOPE = 5.0  # standard deviation of log albedo by chromaticity
_BEND, _BEND_WEIGHT = 0.1, 0.36  # slope per pixel
_MEDIAN_TO_SIGMA = 1.48  # of a Gaussian's absolute deviations
_TINTS = (0.0, _TINT_SLOPE**-2, _TINT_SLOPE**-2)  # how surely albedo is so by chromaticity


@dataclass(frozen=True)
class Objective:
    """The objective at one scale.

    scale: relative error that lights may have. precision: (n, 3), 1 ÷ variance of each light.
    albedo_sigma: of log albedo. stiffness: weight of the bends.
    """

    scene: Scene
    scale: float
    precision: Floats64
    albedo_sigma: float
    stiffness: float

    def cost(self, state: State) -> float:
        """−2 log posterior but for a constant."""
        scene = self.scene
        chi2 = (predicted(scene, state) - scene.light) ** 2 * self.precision
        value = _FREEDOM * np.log1p(chi2 / _FREEDOM).sum()
        value += (state.modes**2).sum() + (state.own**2).sum() + (state.turns**2).sum()
        value += ((state.albedo[:, 1:] / _TINT_SLOPE) ** 2).sum()
        off = (_albedo_residual(scene, state) / self.albedo_sigma) ** 2
        robust = _ALBEDO_FREEDOM * np.log1p(off / _ALBEDO_FREEDOM)
        value += scene.tint_weights @ (robust + 2 * np.log(self.albedo_sigma))
        bends = scene.grid.bends(state.h) / state.h.mean()
        return float(value + self._bending * np.log1p((bends / _BEND) ** 2).sum())

    def chi2(self, state: State) -> Floats64:
        """Squared deviations (n,) of the light in units of its variance."""
        off = predicted(self.scene, state) - self.scene.light
        return np.asarray((off**2 * self.precision).sum(axis=1))

    def lit(self, state: State) -> NDArray[np.bool_]:
        """Lamps (n, J) that light the pixels, of those they face: the set that explains most.

        Shadows are neither looked for along the ways to the lamps nor hung together.
        """
        scene = self.scene
        faced = facing(scene, state)
        shines, by_lamp = np.maximum(faced, 0.0), responses(scene, state)
        lit, least = faced > 0, np.full(len(faced), np.inf)
        for some in product((True, False), repeat=faced.shape[1]):
            off = np.einsum("nj,njx->nx", shines * some, by_lamp) - scene.light
            chi2 = (off**2 * self.precision).sum(axis=1)
            cost = _FREEDOM * np.log1p(chi2 / _FREEDOM) + _SHADOW * (len(some) - sum(some))
            lit[cost < least] = some
            least = np.minimum(cost, least)
        return np.asarray(lit & (faced > 0))

    @property
    def _bending(self) -> float:
        return self.stiffness * _BEND_WEIGHT

    def step(self, state: State) -> State:
        """Change of all unknowns towards the optimum; that of `lit` has no meaning."""
        scene, sums = self.scene, self.scene.sums
        light, slopes = self._light(state), np.tile(_TINTS, (scene.segment_count, 1))
        usual = Rows(np.tile(np.eye(3), (len(slopes), 1, 1)), slopes, state.albedo)
        equations = scene.surface_and_albedo.equations(
            light, self._bends(state), self._albedo(state, -scene.tints), usual
        )
        by_lamps, off_lamps = _by_lamps(scene, state), state.modes.ravel()
        if scene.turning:
            by_lamps = np.concatenate([by_lamps, _by_turns(scene, state)], axis=2)
            off_lamps = np.concatenate([off_lamps, state.turns.ravel()])
        lamps = replace(light, by=by_lamps)
        own = replace(light, by=_by_materials(scene, state))
        lamps_own = sums.of_materials(own.weighed @ lamps.by)
        pairs = sums.of_pairs(own.weighed @ own.by).transpose(0, 2, 1, 3)
        k, m = off_lamps.size, state.own.size
        corner = np.eye(k + m)
        corner[:k, :k] += (lamps.weighed @ lamps.by).sum(axis=0)
        corner[k:, :k] = lamps_own.reshape(m, k)
        corner[:k, k:] = corner[k:, :k].T
        corner[k:, k:] += pairs.reshape(m, m)
        border = np.zeros((state.h.size + state.albedo.size, k + m), order="F")
        border[: state.h.size, :k] = sums.at_corners(light.weighed @ lamps.by)
        by_materials = sums.at_corners_of_materials(light.weighed @ own.by)
        border[: state.h.size, k:] = by_materials.reshape(-1, m)
        uphill = lamps.slope.sum(axis=0), sums.of_materials(own.slope).ravel()
        inner, outer = equations.solution_with(
            border,
            corner,
            -np.concatenate([uphill[0] + off_lamps, uphill[1] + state.own.ravel()]),
        )
        h, albedo = np.split(inner, [state.h.size])
        modes, turns, deviations = np.split(outer, [state.modes.size, k])
        return State(
            h,
            modes.reshape(state.modes.shape),
            deviations.reshape(state.own.shape),
            albedo.reshape(state.albedo.shape),
            turns.reshape(state.turns.shape) if scene.turning else np.zeros_like(state.turns),
            state.lit,
        )

    def surface_step(self, state: State) -> Floats64:
        """Change (c,) of the squared depths alone."""
        rows = self._light(state), self._bends(state), self._albedo(state, None)
        return self.scene.surface.equations(*rows).solution()

    def _light(self, state: State) -> Rows:
        """Light of the pixels, by h at their corners."""
        scene = self.scene
        residual = predicted(scene, state) - scene.light
        precision = self.precision / (1 + residual**2 * self.precision / _FREEDOM)
        lit = responses(scene, state) * state.lit[:, :, None]
        by_w = lit.transpose(0, 2, 1) @ directions(scene, state)
        return Rows(by_w @ scene.grid.to_w, precision, residual)

    def _bends(self, state: State) -> Rows:
        """Bends, by h at their three corners."""
        grid, mean = self.scene.grid, state.h.mean()
        bends = grid.bends(state.h) / mean
        precision = self._bending / _BEND**2 / (1 + (bends / _BEND) ** 2)
        by = np.broadcast_to(grid.to_bend / mean, (len(bends), 1, 3))
        return Rows(by, precision[:, None], bends[:, None])

    def _albedo(self, state: State, also: Floats64 | None) -> Rows:
        """Log albedo of the pixels in segments, by h at their corners and by what else is given."""
        scene, own = self.scene, self.scene.tinted
        off = _albedo_residual(scene, state)
        robust = 1 + (off / self.albedo_sigma) ** 2 / _ALBEDO_FREEDOM
        precision = scene.tint_weights / (self.albedo_sigma**2 * robust)
        w = scene.grid.w(state.h)[own]
        by_h = np.einsum("nc,nck->nk", w / (w**2).sum(axis=1)[:, None], scene.grid.to_w[own])
        by = by_h if also is None else np.concatenate([by_h, also], axis=1)
        return Rows(by[:, None], precision[:, None], off[:, None])


def make_objective(scene: Scene, state: State, scale: float, stiffness: float = 1.0) -> Objective:
    """The objective about a state, whose albedo tells how even albedo is."""
    floor = _FLOOR * np.percentile(scene.light, 99)
    precision = 1.0 / (scene.variance + (scale * scene.light) ** 2 + floor**2)
    variance = _albedo_variance(_albedo_residual(scene, state))
    variance *= max(1.0, scale / _ALBEDO_SCALE)
    return Objective(scene, scale, precision, float(np.sqrt(variance)), stiffness)


def with_even_albedo(scene: Scene, state: State) -> State:
    """The state with the median albedo of every segment."""
    level = np.zeros((scene.segment_count, 3))
    off = _albedo_residual(scene, replace(state, albedo=level))
    own = scene.segments[scene.tinted]
    level[:, 0] = [np.median(off[own == segment]) for segment in range(scene.segment_count)]
    return replace(state, albedo=level)


def albedo_off(scene: Scene, state: State) -> Floats64:
    """By how much (t,) log albedo is off what the segment has, in standard deviations."""
    residual = _albedo_residual(scene, state)
    return np.asarray(np.abs(residual) / np.sqrt(_albedo_variance(residual)))


def _albedo_variance(residual: Floats64) -> float:
    """Variance of log albedo, by the residuals (t,) themselves."""
    spread = _MEDIAN_TO_SIGMA * float(np.median(np.abs(residual))) if len(residual) else 0.0
    return spread**2 + _ALBEDO_FLOOR**2


def _albedo_residual(scene: Scene, state: State) -> Floats64:
    """Log albedo (t,), s_f|w|, beside what its segment has."""
    own = scene.tinted
    length = np.linalg.norm(scene.grid.w(state.h)[own], axis=1)
    log = np.log(scene.total[own] * np.maximum(length, 1e-12))
    return np.asarray(log - (state.albedo[scene.segments[own]] * scene.tints).sum(axis=1))


def _by_lamps(scene: Scene, state: State) -> Floats64:
    """Light by the lamps' modes, (n, 3, Jk)."""
    modes = np.stack([prior.modes for prior in scene.priors])
    by_modes = np.einsum(
        "nj,jkxy,ny->nxjk", brightness(scene, state), modes, scene.flash, optimize=True
    )
    return np.asarray(by_modes.reshape(*scene.light.shape, -1))


def _by_turns(scene: Scene, state: State) -> Floats64:
    """Light by the turns of the lamps, (n, 3, 2J)."""
    by_turns = np.einsum(
        "njx,nj,jtc,nc->nxjt",
        responses(scene, state),
        state.lit,
        directions_by_turns(scene, state),
        scene.grid.w(state.h),
        optimize=True,
    )
    return np.asarray(by_turns.reshape(*scene.light.shape, -1))


def _by_materials(scene: Scene, state: State) -> Floats64:
    """Light by the deviations of one material that has all of a pixel, (n, 3, 3J)."""
    deviations = np.stack([prior.material for prior in scene.priors])
    values = np.einsum(
        "n,nj,jxc->nxjc", scene.total, brightness(scene, state), deviations, optimize=True
    )
    return np.asarray(values.reshape(*scene.light.shape, -1))
