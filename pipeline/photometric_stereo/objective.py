"""How well a surface and its lamps explain a pair: −2 log posterior, and a Gauss–Newton step on it.

Four parts, robust but for the second: the light of every pixel; how far lamps and materials leave
what is usual; the albedo of a segment, which is even but for what chromaticity tells; bends of the
surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from pipeline.photometric_stereo.scene import Scene, State, predicted, responses

Array = NDArray[np.float64]

_FREEDOM = 9.0  # squared standard deviations beyond which a pixel's light counts less
_FLOOR = 0.002  # of the 99th percentile of the light
_ALBEDO_FREEDOM = 4.0
_ALBEDO_FLOOR, _ALBEDO_SCALE = 0.01, 0.02
_TINT_SLOPE = 5.0  # standard deviation of log albedo by chromaticity
_BEND, _BEND_WEIGHT = 0.1, 0.36  # slope per pixel
_MEDIAN_TO_SIGMA = 1.48
_RIDGE = 1e-9  # of the mean diagonal, so that nothing is singular
_WIDE = 0.1  # of all unknowns


@dataclass(frozen=True)
class Objective:
    """The objective at one scale.

    scale: relative error that lights may have. precision: (n, 3), 1 ÷ variance of each light.
    albedo_sigma: of log albedo. stiffness: weight of the bends.
    """

    scene: Scene
    scale: float
    precision: Array
    albedo_sigma: float
    stiffness: float

    def cost(self, state: State) -> float:
        """−2 log posterior but for a constant."""
        scene = self.scene
        chi2 = (predicted(scene, state) - scene.light) ** 2 * self.precision
        value = _FREEDOM * np.log1p(chi2 / _FREEDOM).sum()
        value += (state.modes**2).sum() + (state.own**2).sum()
        value += ((state.albedo[:, 1:] / _TINT_SLOPE) ** 2).sum()
        off = (_albedo_residual(scene, state) / self.albedo_sigma) ** 2
        robust = _ALBEDO_FREEDOM * np.log1p(off / _ALBEDO_FREEDOM)
        value += scene.tint_weights @ (robust + 2 * np.log(self.albedo_sigma))
        bends = scene.grid.bends @ state.h / state.h.mean()
        return float(value + self._bending * np.log1p((bends / _BEND) ** 2).sum())

    def chi2(self, state: State) -> Array:
        """Squared deviations (n,) of the light in units of its variance."""
        off = predicted(self.scene, state) - self.scene.light
        return np.asarray((off**2 * self.precision).sum(axis=1))

    @property
    def _bending(self) -> float:
        return self.stiffness * _BEND_WEIGHT

    def step(self, state: State) -> State:
        """Change of all unknowns towards the optimum; that of `lit` has no meaning."""
        surface, light_h, precision, residual = self._surface(state)
        lamps, materials = _by_lamps(self.scene, state)
        tints = _by_tints(self.scene)
        albedo_h, albedo_precision, albedo_off = self._albedo(state)
        by_materials = _scaled(materials, precision)
        by_tints = _scaled(tints, albedo_precision)
        by_lamps = lamps * precision[:, None]
        off = precision * residual
        slope = np.tile([0.0, _TINT_SLOPE**-2, _TINT_SLOPE**-2], self.scene.segment_count)
        block = sparse.csr_array
        h_lamps, h_materials = block(light_h.T @ by_lamps), light_h.T @ by_materials
        h_tints, lamps_materials = albedo_h.T @ by_tints, block((by_materials.T @ lamps).T)
        matrix = sparse.block_array(
            [
                [surface[0], h_tints, h_materials, h_lamps],
                [h_tints.T, tints.T @ by_tints + sparse.diags_array(slope), None, None],
                [h_materials.T, None, _plus_one(materials.T @ by_materials), lamps_materials.T],
                [h_lamps.T, None, lamps_materials, _plus_one(block(lamps.T @ by_lamps))],
            ],
            format="csc",
        )
        gradient = np.concatenate(
            [
                surface[1],
                by_tints.T @ albedo_off + slope * state.albedo.ravel(),
                materials.T @ off + state.own.ravel(),
                lamps.T @ off + state.modes.ravel(),
            ]
        )
        sizes = (state.h.size, state.albedo.size, state.own.size)
        h, albedo, own, modes = np.split(_solved(matrix, -gradient), np.cumsum(sizes))
        return State(
            h,
            modes.reshape(state.modes.shape),
            own.reshape(state.own.shape),
            albedo.reshape(state.albedo.shape),
            state.lit,
        )

    def surface_step(self, state: State) -> Array:
        """Change (c,) of the squared depths alone."""
        (matrix, gradient), *_ = self._surface(state)
        return _solved(matrix, -gradient)

    def _surface(
        self, state: State
    ) -> tuple[tuple[sparse.csr_array, Array], sparse.csr_array, Array, Array]:
        """Normal matrix and gradient of h; light by h, its precision (3n,) and residual (3n,)."""
        scene, grid = self.scene, self.scene.grid
        residual = predicted(scene, state) - scene.light
        precision = self.precision / (1 + residual**2 * self.precision / _FREEDOM)
        lit = responses(scene, state) * state.lit[:, :, None]
        by_w = np.einsum("njx,jc->nxc", lit, scene.directions)
        light_h = _rows(by_w @ grid.to_w, grid.corners[:, None], len(state.h))
        albedo_h, albedo_precision, albedo_off = self._albedo(state)
        bends = grid.bends / state.h.mean()
        bent = bends @ state.h
        stiff = self._bending / _BEND**2 / (1 + (bent / _BEND) ** 2)
        matrix = light_h.T @ _scaled(light_h, precision.ravel())
        matrix += albedo_h.T @ _scaled(albedo_h, albedo_precision)
        matrix += bends.T @ _scaled(bends, stiff)
        gradient = light_h.T @ (precision * residual).ravel()
        gradient += albedo_h.T @ (albedo_precision * albedo_off) + bends.T @ (stiff * bent)
        return (matrix, gradient), light_h, precision.ravel(), residual.ravel()

    def _albedo(self, state: State) -> tuple[sparse.csr_array, Array, Array]:
        """Log albedo by h, its precision (t,) and residual (t,)."""
        scene, own = self.scene, self.scene.tinted
        off = _albedo_residual(scene, state)
        robust = 1 + (off / self.albedo_sigma) ** 2 / _ALBEDO_FREEDOM
        precision = scene.tint_weights / (self.albedo_sigma**2 * robust)
        w = scene.grid.w(state.h)[own]
        by_h = np.einsum("nc,nck->nk", w / (w**2).sum(axis=1)[:, None], scene.grid.to_w[own])
        return _rows(by_h[:, None], scene.grid.corners[own][:, None], len(state.h)), precision, off


def make_objective(scene: Scene, state: State, scale: float, stiffness: float = 1.0) -> Objective:
    """The objective about a state, whose albedo tells how even albedo is."""
    floor = _FLOOR * np.percentile(scene.light, 99)
    precision = 1.0 / (scene.variance + (scale * scene.light) ** 2 + floor**2)
    off = np.abs(_albedo_residual(scene, state))
    spread = _MEDIAN_TO_SIGMA * float(np.median(off)) if len(off) else 0.0
    variance = (spread**2 + _ALBEDO_FLOOR**2) * max(1.0, scale / _ALBEDO_SCALE)
    return Objective(scene, scale, precision, float(np.sqrt(variance)), stiffness)


def with_even_albedo(scene: Scene, state: State) -> State:
    """The state with the median albedo of every segment."""
    level = np.zeros((scene.segment_count, 3))
    off = _albedo_residual(scene, replace(state, albedo=level))
    own = scene.segments[scene.tinted]
    level[:, 0] = [np.median(off[own == segment]) for segment in range(scene.segment_count)]
    return replace(state, albedo=level)


def _albedo_residual(scene: Scene, state: State) -> Array:
    """Log albedo (t,), s_f|w|, beside what its segment has."""
    own = scene.tinted
    length = np.linalg.norm(scene.grid.w(state.h)[own], axis=1)
    log = np.log(scene.total[own] * np.maximum(length, 1e-12))
    return np.asarray(log - (state.albedo[scene.segments[own]] * scene.tints).sum(axis=1))


def _by_lamps(scene: Scene, state: State) -> tuple[Array, sparse.csr_array]:
    """Light by the lamps' modes (3n, Jk), and by the materials' deviations (3n, 3mJ)."""
    brightness = (scene.grid.w(state.h) @ scene.directions.T) * state.lit
    n, J = brightness.shape
    modes = np.stack([prior.modes for prior in scene.priors])
    by_modes = np.einsum("nj,jkxy,ny->nxjk", brightness, modes, scene.flash, optimize=True)
    which, share = scene.shares
    deviations = np.stack([prior.material for prior in scene.priors])
    values = np.einsum(
        "n,nm,nj,jxc->nxmjc", scene.total, share, brightness, deviations, optimize=True
    )
    columns = (which[:, None, :, None, None] * J + np.arange(J)[:, None]) * 3 + np.arange(3)
    return by_modes.reshape(3 * n, -1), _rows(
        values.reshape(n, 3, -1),
        np.broadcast_to(columns, values.shape).reshape(n, 3, -1),
        len(scene.materials) * J * 3,
    )


def _by_tints(scene: Scene) -> sparse.csr_array:
    """Log albedo beside its segment's, by (t, 3S) that of the segments."""
    columns = scene.segments[scene.tinted][:, None, None] * 3 + np.arange(3)
    return _rows(-scene.tints[:, None], columns, 3 * scene.segment_count)


def _rows(values: Array, columns: NDArray[np.intp], width: int) -> sparse.csr_array:
    """Sparse (n·r, width) of values (n, r, k) in columns (n, r or 1, k)."""
    n, r, k = values.shape
    places = np.broadcast_to(columns, values.shape).reshape(-1)
    return sparse.csr_array(
        (values.reshape(-1), places, np.arange(0, n * r * k + 1, k)), shape=(n * r, width)
    )


def _scaled(rows: sparse.csr_array, weights: Array) -> sparse.csr_array:
    return sparse.diags_array(weights) @ rows


def _plus_one(matrix: sparse.csr_array) -> sparse.csr_array:
    return matrix + sparse.eye_array(matrix.shape[0])


def _solved(matrix: sparse.sparray, right: Array) -> Array:
    """Solve a symmetric, positive system, unknowns that most others hang on by themselves.

    Those are few, lamps and wide materials, and would fill up the factors of the rest.
    """
    ridge = _RIDGE * matrix.diagonal().mean() * sparse.eye_array(matrix.shape[0])
    whole = sparse.csc_array(matrix + ridge)
    wide = np.diff(whole.indptr) > _WIDE * whole.shape[0]
    few = sparse.csc_array(whole[:, wide])
    border, corner = few[~wide].toarray(), few[wide].toarray()
    factors = splu(
        sparse.csc_matrix(whole[:, ~wide][~wide]),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    by_border = factors.solve(border)
    alone = factors.solve(right[~wide])
    solution = np.empty_like(right)
    solution[wide] = np.linalg.solve(corner - border.T @ by_border, right[wide] - border.T @ alone)
    solution[~wide] = alone - by_border @ solution[wide]
    return solution
