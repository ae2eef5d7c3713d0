"""Fits surface, lamps and materials to a pair, together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.photometric_stereo.objective import Objective, make_objective, with_even_albedo
from pipeline.photometric_stereo.scene import Scene, State, predicted

Array = NDArray[np.float64]

_SCALES = (0.3, 0.2, 0.1, 0.05, 0.03, 0.02, 0.01, 0.005, 0.003, 0.003)
_STEPS = 3
_LENGTHS = (1.0, 0.5, 0.25, 0.1)
_FINE_SCALE, _FINE_STEPS, _FINE_STIFFNESS = 0.01, 3, 10.0
_SHADOWS_FROM, _SHADOW_CHI2, _SHADOW_GAIN = 0.02, 50.0, 10.0
_LEAST_DEPTH = 1e-3  # squared, of the median


def fit(scene: Scene) -> tuple[State, float]:
    """The likeliest surface, lamps and materials, and −2 log posterior.

    From a flat and from an inflated start, as one of them may lead astray: the likelier is taken.
    """
    found = [_follow(scene, h) for h in (scene.grid.flat(), scene.grid.inflated())]
    return min(found, key=lambda one: one[1])


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
