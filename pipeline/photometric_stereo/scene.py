"""What is known of a surface before it is fitted, and what is not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.photometric_stereo.equations import Pattern
from pipeline.photometric_stereo.grid import Grid, carried
from pipeline.photometric_stereo.materials import Materials, find_segments
from pipeline.photometric_stereo.responses import ResponsePrior
from pipeline.photometric_stereo.sums import Sums
from pipeline.vectors import unit

_RIDGE = 1e-9  # of the trace, so that nothing is singular
_TURN = np.radians(5.0)  # by which directions that are given may be off
_DARK = 30.0  # percentile of the flash part below which albedo tells less


@dataclass(frozen=True)
class Scene:
    """The n pixels of a surface under J lamps.

    grid: of the pixels. directions: (J, 3) unit, to the lamps, as given. flash, light: (n, 3), the
    flash part and the light of the lamps. variance: (n, 3), what noise of both makes of their
    comparison. priors: of each lamp. materials: of the surface. turning: whether a step turns the
    lamps' directions, too.
    """

    grid: Grid
    directions: Floats64
    flash: Floats64
    light: Floats64
    variance: Floats64
    priors: tuple[ResponsePrior, ...]
    materials: Materials
    turning: bool = False

    def without(self, off: NDArray[np.bool_]) -> Scene:
        """The scene without some of its pixels (n,)."""
        return replace(
            self,
            grid=self.grid.without(off),
            flash=self.flash[~off],
            light=self.light[~off],
            variance=self.variance[~off],
        )

    @cached_property
    def total(self) -> Floats64:
        """Sum (n,) of the flash part's channels."""
        return np.asarray(self.flash.sum(axis=1))

    @cached_property
    def shares(self) -> tuple[NDArray[np.intp], Floats64]:
        """Materials of each pixel and their weights, both (n, k)."""
        return self.materials.shares(self._chromaticity)

    @cached_property
    def segments(self) -> NDArray[np.intp]:
        """Number (n,) of the connected area of one material that a pixel is in, −1 in none."""
        return find_segments(self.shares[0][:, 0], self.grid.mask)

    @cached_property
    def segment_count(self) -> int:
        """How many segments there are."""
        return int(self.segments.max(initial=-1)) + 1

    @cached_property
    def tinted(self) -> NDArray[np.intp]:
        """Places (t,) of the pixels that are in a segment."""
        return np.flatnonzero(self.segments >= 0)

    @cached_property
    def tints(self) -> Floats64:
        """1 and the chromaticity beside the segment's mean, (t, 3): what albedo varies with."""
        own, chromaticity = self.segments[self.tinted], self._chromaticity[self.tinted]
        count = np.bincount(own, minlength=self.segment_count)
        mean = [np.bincount(own, c, self.segment_count) / count for c in chromaticity.T]
        beside = chromaticity - np.stack(mean, axis=1)[own]
        return np.concatenate([np.ones((len(own), 1)), beside], axis=1)

    @cached_property
    def tint_weights(self) -> Floats64:
        """How much (t,) the albedo of each pixel in a segment counts, 0…1."""
        return np.minimum(1.0, self.total / np.percentile(self.total, _DARK))[self.tinted]

    @cached_property
    def sums(self) -> Sums:
        """Sums over the pixels."""
        counts = self.grid.corner_count, len(self.materials)
        return Sums(self.grid.corners, *self.shares, *counts)

    @cached_property
    def surface(self) -> Pattern:
        """Equations of h, by light (n, 4), bends (b, 3) and albedo of pixels in segments (t, 4)."""
        grid = self.grid
        return Pattern(grid.corner_count, grid.corners, grid.bent, grid.corners[self.tinted])

    @cached_property
    def surface_and_albedo(self) -> Pattern:
        """The same of h and albedo: by that of pixels (t, 7), and by what is usual (S, 3)."""
        grid = self.grid
        tints = grid.corner_count + np.arange(3 * self.segment_count).reshape(-1, 3)
        own = np.concatenate([grid.corners[self.tinted], tints[self.segments[self.tinted]]], axis=1)
        size = grid.corner_count + tints.size
        return Pattern(size, grid.corners, grid.bent, own, tints)

    @cached_property
    def across(self) -> Floats64:
        """Two unit vectors (J, 2, 3) across each direction and each other."""
        return np.linalg.svd(self.directions[:, None])[2][:, 1:]

    @property
    def _chromaticity(self) -> Floats64:
        return np.asarray(self.flash[:, :2] / self.total[:, None])


@dataclass(frozen=True)
class State:
    """The unknowns.

    h: (c,) squared depths at the corners of pixels. modes: (J, k) of each lamp's matrix along its
    prior's modes. own: (m, J, 3) each material's deviations, whitened. albedo: (S, 3) log albedo of
    each segment at its mean chromaticity, and its slopes. turns: (J, 2) of each lamp's direction
    from the one given, whitened. lit: bool (n, J).
    """

    h: Floats64
    modes: Floats64
    own: Floats64
    albedo: Floats64
    turns: Floats64
    lit: NDArray[np.bool_]


def moved_to(scene: Scene, other: Scene, state: State) -> State:
    """A state of another scene as that of this one, but for its albedo and which lamps shine."""
    return replace(state, h=carried(state.h, other.grid, scene.grid))


def directions(scene: Scene, state: State) -> Floats64:
    """Unit directions (J, 3) to the lamps, as far turned from those given as the state says."""
    return unit(scene.directions + _TURN * np.einsum("jt,jtc->jc", state.turns, scene.across))


def directions_by_turns(scene: Scene, state: State) -> Floats64:
    """Derivatives (J, 2, 3) of the directions by the turns."""
    towards = directions(scene, state)
    along = np.einsum("jtc,jc->jt", scene.across, towards)
    # 1 ÷ the length that `directions` takes off
    scale = _TURN * np.einsum("jc,jc->j", scene.directions, towards)
    return np.asarray(scale[:, None, None] * (scene.across - along[..., None] * towards[:, None]))


def response_matrices(scene: Scene, state: State) -> tuple[Floats64, Floats64]:
    """Matrices (J, 3, 3) of the lamps, and deviations (n, J, 3) of each pixel's material."""
    mean, modes = (np.stack([getattr(p, name) for p in scene.priors]) for name in ("mean", "modes"))
    material = np.stack([prior.material for prior in scene.priors])
    own = np.einsum("jxc,mjc->mjx", material, state.own)
    which, share = scene.shares
    matrices = mean + np.einsum("jk,jkxy->jxy", state.modes, modes)
    return matrices, np.einsum("nm,nmjx->njx", share, own[which])


def responses(scene: Scene, state: State) -> Floats64:
    """Light (n, J, 3) of each lamp where l·w is 1: T_j I_f + s_f Σ_m φ_m δ_mj."""
    matrices, deviations = response_matrices(scene, state)
    light = np.einsum("jxy,ny->njx", matrices, scene.flash)
    return np.asarray(light + scene.total[:, None, None] * deviations)


def facing(scene: Scene, state: State) -> Floats64:
    """l·w (n, J) of every lamp, below 0 where a pixel faces away from it."""
    return np.asarray(scene.grid.w(state.h) @ directions(scene, state).T)


def brightness(scene: Scene, state: State) -> Floats64:
    """How bright (n, J) each lamp is: l·w where it lights the pixel, else 0."""
    return np.asarray(facing(scene, state) * state.lit)


def predicted(scene: Scene, state: State) -> Floats64:
    """Light (n, 3) of the lamps."""
    return np.asarray(np.einsum("nj,njx->nx", brightness(scene, state), responses(scene, state)))


def lamp_light(scene: Scene, state: State, precision: Floats64) -> Floats64:
    """How bright (n, J) each lamp is by the light of a pixel alone, in units of l·w.

    precision: (n, 3), 1 ÷ variance of the light. Least squares in the lamps' responses.
    """
    by_lamp = responses(scene, state)
    normal = np.einsum("njx,nx,nkx->njk", by_lamp, precision, by_lamp)
    right = np.einsum("njx,nx->nj", by_lamp, precision * scene.light)
    ridge = _RIDGE * np.einsum("njj->n", normal)[:, None, None] * np.eye(normal.shape[1])
    return np.asarray(np.linalg.solve(normal + ridge, right[..., None])[..., 0])
