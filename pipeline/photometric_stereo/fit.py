"""Fits surface, lamps and materials to a pair, together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.frames import Mask
from pipeline.photometric_stereo.objective import Objective, make_objective, with_even_albedo
from pipeline.photometric_stereo.scene import Scene, State, predicted

Array = NDArray[np.float64]

_SCALES = (0.3, 0.2, 0.1, 0.05, 0.03, 0.02, 0.01, 0.005, 0.003, 0.003)
_STEPS = 3
_LENGTHS = (1.0, 0.5, 0.25, 0.1)
_FINE_SCALE, _FINE_STEPS, _FINE_STIFFNESS = 0.01, 3, 10.0
_SHADOWS_FROM, _SHADOW_CHI2, _SHADOW_GAIN = 0.02, 50.0, 10.0
_MOST_CUTS, _LEAST_CUT, _CUT_SCALE, _CUT_CHI2 = 3, 0.01, 0.02, 10.0
_FEWER = 0.5  # of the pixels that a surface without seams leaves unexplained
_LEAST_PART, _LEAST_LEFT = 0.01, 0.5  # of the surface
_LEAST_DEPTH = 1e-3  # squared, of the median


def fit(scene: Scene) -> tuple[State, float]:
    """The likeliest surface, lamps and materials, and −2 log posterior.

    From a flat and from an inflated start, as one of them may lead astray: the likelier is taken.
    """
    found = [_follow(scene, h) for h in (scene.grid.flat(), scene.grid.inflated())]
    return min(found, key=lambda one: one[1])


def fit_in_parts(scene: Scene) -> tuple[Scene, State]:
    """The likeliest surface of a scene, cut where no continuous one explains the light.

    A jump of depth leaves pixels beside it that no lamp explains. Without them its sides hang
    together no longer, and each finds its own distance by the fall-off of the flash. Returns what
    is left of the scene as well.
    """
    state, _ = fit(scene)
    whole, off, cuts = scene, _unexplained(scene, state), 0
    many = _FEWER * off.mean()
    while off.mean() > _LEAST_CUT and cuts < _MOST_CUTS:
        mask = scene.grid.mask.copy()
        mask[mask] = ~off
        left = parts_of(mask) > 0
        if left.sum() < _LEAST_LEFT * len(whole.light):
            break
        scene, cuts = scene.without(~left[scene.grid.mask]), cuts + 1
        state, _ = fit(scene)
        off = _unexplained(scene, state)
    if not cuts:
        return scene, state
    # most of what was cut out belongs to one side or the other
    seams = _seams(whole.grid.mask, scene.grid.mask)
    seamed = whole.without(seams[whole.grid.mask])
    found, _ = fit(seamed)
    return (seamed, found) if _unexplained(seamed, found).mean() < many else (scene, state)


def parts_of(mask: Mask) -> NDArray[np.intp]:
    """Number the parts (H, W) of a mask that hang together, from 1; 0 outside and in crumbs."""
    parts, _ = ndimage.label(mask)
    sizes = np.bincount(parts.ravel())
    parts[sizes[parts] < _LEAST_PART * mask.sum()] = 0
    return np.asarray(parts)


def _unexplained(scene: Scene, state: State) -> Mask:
    """Pixels (n,) whose light the lamps do not give."""
    return make_objective(scene, state, _CUT_SCALE).chi2(state) > _CUT_CHI2


def _seams(whole: Mask, kept: Mask) -> Mask:
    """Where parts of what was kept meet, when they are widened to fill the whole again."""
    # thin bridges between parts are none
    parts = parts_of(ndimage.binary_erosion(kept | ~whole) & whole)
    nearest = ndimage.distance_transform_edt(
        parts == 0, return_distances=False, return_indices=True
    )
    widened = np.where(whole, parts[*nearest], 0)
    seams = np.zeros_like(whole)
    for ahead, behind in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        meet = (widened[ahead] != widened[behind]) & (widened[ahead] > 0) & (widened[behind] > 0)
        seams[ahead] |= meet
    return seams


def refine(scene: Scene, h: Array, found: State) -> State:
    """The surface of a finer scene, lamps and materials as found. h: (c,) where it starts."""
    lit = scene.grid.w(h) @ scene.directions.T > 0
    state = with_even_albedo(scene, replace(found, h=h, lit=lit))
    for _ in range(_FINE_STEPS):
        objective = make_objective(scene, state, _FINE_SCALE, _FINE_STIFFNESS)
        state = _relit(replace(state, h=_valid(state.h + objective.surface_step(state))), objective)
    return state


def _follow(scene: Scene, h: Array) -> tuple[State, float]:
    """Follow a start h (c,) while what counts as an outlier becomes less and less."""
    state = _start(scene, h)
    for scale in _SCALES:
        for _ in range(_STEPS):
            objective = make_objective(scene, state, scale)
            state = _relit(_moved(objective, state), objective)
    return state, make_objective(scene, state, _SCALES[-1]).cost(state)


def _start(scene: Scene, h: Array) -> State:
    """Lamps and materials as is usual, h (c,) scaled to how bright the lamps are."""
    lamps, modes = len(scene.directions), len(scene.priors[0].modes)
    lit = scene.grid.w(h) @ scene.directions.T > 0
    own = np.zeros((len(scene.materials), lamps, 3))
    state = State(h, np.zeros((lamps, modes)), own, np.zeros((scene.segment_count, 3)), lit)
    brightness = np.median(scene.light.sum(axis=1)) / np.median(predicted(scene, state).sum(axis=1))
    return with_even_albedo(scene, replace(state, h=h * brightness))


def _moved(objective: Objective, state: State) -> State:
    """One step on, the longest that makes things better, or else the shortest."""
    step, before = objective.step(state), objective.cost(state)
    moved = state
    for length in _LENGTHS:
        moved = State(
            _valid(state.h + length * step.h),
            state.modes + length * step.modes,
            state.own + length * step.own,
            state.albedo + length * step.albedo,
            state.lit,
        )
        if objective.cost(moved) < before:
            break
    return moved


def _valid(h: Array) -> Array:
    return np.maximum(h, _LEAST_DEPTH * np.median(h))


def _relit(state: State, objective: Objective) -> State:
    """Find anew which lamps light which pixels: those it faces and that are not in its shadow."""
    scene = objective.scene
    facing = scene.grid.w(state.h) @ scene.directions.T > 0
    if objective.scale > _SHADOWS_FROM:
        return replace(state, lit=facing)
    lamps = range(len(scene.directions))
    chi2 = objective.chi2(replace(state, lit=facing))
    shadowed = np.zeros_like(facing)
    for j in lamps:
        without = facing.copy()
        without[:, j] = False
        less = objective.chi2(replace(state, lit=without))
        shadowed[:, j] = (chi2 > _SHADOW_CHI2) & (_SHADOW_GAIN * less < chi2)
    return replace(state, lit=facing & ~shadowed)
