"""Fits surface, lamps and materials to a pair, together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Mask
from pipeline.photometric_stereo.objective import Objective, make_objective, with_even_albedo
from pipeline.photometric_stereo.scene import (
    Scene,
    State,
    directions,
    facing,
    lamp_light,
    predicted,
)
from pipeline.progress import Tick
from pipeline.vectors import angles_deg

# Chosen on development objects (docs/trials/normals.md)
_SCALES = (0.3, 0.2, 0.1, 0.05, 0.03, 0.02, 0.01, 0.005, 0.003, 0.003)  # see Objective
_SCALES_AGAIN, _ROUNDS = (0.1, 0.05, 0.02, 0.01, 0.005, 0.003, 0.003), 2
_STEPS = 3  # at each scale
_SCALES_ON, _STEPS_ON = (0.02, 0.01, 0.005, 0.003), 2
_LENGTHS = (1.0, 0.5, 0.25, 0.1)  # of a step, tried until one makes things better
_FINE_SCALE, _FINE_STEPS, _FINE_STIFFNESS = 0.01, 3, 10.0
_CONTINUED_STEPS = 2
_SHADOWS_FROM = 0.02  # scale from which on shadows are told from bends
_UNEXPLAINED = 0.01  # share of the pixels from which on shadows are to blame
_MUCH_UNEXPLAINED = 0.05
_TURNED_STEPS = 8
_TURNED_GAIN, _TURNED_DEG = 0.3, 3.0  # least −2 log posterior of a pixel; least turn
_LIGHT_SCALE, _LIGHT_CHI2 = 0.02, 10.0  # at and above which light is unexplained
_DARK = 0.06  # l·w of a lamp that does not shine, of the median squared depth
_LEAST_DEPTH = 1e-3  # squared, of the median


MOST_TRIAL_TICKS = 2 * len(_SCALES)
MOST_TICKS = MOST_TRIAL_TICKS + _ROUNDS * 3 * len(_SCALES_AGAIN)
MOST_TICKS += 2 * (len(_SCALES_AGAIN) + len(_SCALES_ON))
MOST_TICKS_ON = len(_SCALES_AGAIN) + 2 * len(_SCALES_ON)
MOST_TICKS_AGAIN = 3 * len(_SCALES_AGAIN) + MOST_TICKS
MOST_TICKS_WHOLE = MOST_TRIAL_TICKS + MOST_TICKS
"""Most calls of tick by fit with rounds=0, fit, fit_on, fit_again and fit_whole."""


def fit(scene: Scene, tick: Tick = lambda: None, rounds: int = _ROUNDS) -> tuple[State, float]:
    """The likeliest surface, lamps and materials, and −2 log posterior.

    From a flat and from an inflated start, as one of them may lead astray: the likelier is taken.
    Where it leaves light unexplained, a shadow has bent the surface, and the light itself tells
    which lamps shine where: with the lamps that layers were separated by, which shadows told best,
    and then with lamps and materials as found, the surface starts anew, at most so many rounds.
    tick: called before every scale.
    """
    found = min((_follow(scene, _start(scene, h), tick) for h in _starts(scene)), key=_likeliest)
    return _through_shadows(scene, found, tick, rounds)


def fit_whole(scene: Scene, tick: Tick = lambda: None) -> tuple[State, float]:
    """The likeliest surface of a scene of which nothing is cut yet, lamps and materials, and cost.

    Directions that are not as given leave light unexplained, as shadows and jumps do. If all is
    explained once the lamps may turn, they were to blame. tick: called before every scale.
    """
    found = fit(scene, tick, rounds=0)
    if unexplained(scene, found[0]).mean() >= _UNEXPLAINED:
        turned = fit(replace(scene, turning=True), tick, rounds=0)
        explained = unexplained(scene, turned[0]).mean() < _UNEXPLAINED
        if explained and _clearly_turned(scene, found[0], turned[0]):
            return turned
    return _through_shadows(scene, found, tick, _ROUNDS)


def fit_again(scene: Scene, state: State, tick: Tick = lambda: None) -> State:
    """The likeliest surface with lamps and materials of a like scene to begin with.

    state: h (c,) of this scene, modes and materials of the other. The surface starts from flat,
    inflated and as it is, while the light tells which lamps shine where. Where that leaves much
    light unexplained, all is fitted anew, too, and the likelier taken: lamps and materials may be
    wrong, or noise hides which lamps shine.
    """
    # no rival to what it leads to: what it does not explain is not in the scene
    found = state, np.inf
    for _ in range(_ROUNDS):
        better = _better(scene, found, tick)
        if better is found:
            break
        found = better
        if unexplained(scene, found[0]).mean() < _UNEXPLAINED:
            break
    if unexplained(scene, found[0]).mean() > _MUCH_UNEXPLAINED:
        found = min(found, fit(scene, tick), key=_likeliest)
    return found[0]


def fit_on(scene: Scene, state: State, tick: Tick = lambda: None) -> State:
    """The likeliest that lamps, materials and surface of a state lead on to; it may be less likely.

    Lamps shine where surface and light say so, from the start or after the light alone does.
    """
    again = _follow_again(scene, state, state.h, tick)
    also = [_follow_on(scene, one, tick) for one in (state, again[0])]
    return min([again, *also], key=_likeliest)[0]


def fit_turned(scene: Scene, state: State) -> State:
    """The state with its lamps turned to where all is likeliest, if they do so clearly."""
    turning, turned = replace(scene, turning=True), state
    for _ in range(_TURNED_STEPS):
        objective = make_objective(turning, turned, _SCALES[-1])
        turned = _relit(_moved(objective, turned), objective)
    return turned if _clearly_turned(scene, state, turned) else state


def _clearly_turned(scene: Scene, state: State, turned: State) -> bool:
    """Whether the other state's directions are clearly likelier and others.

    Directions that are given exactly turn by up to 1.8 degrees, or for hardly any gain.
    """
    gain = (cost(scene, state) - cost(scene, turned)) / len(scene.light)
    off = angles_deg((directions(scene, state) * directions(scene, turned)).sum(axis=1))
    return bool(gain > _TURNED_GAIN and off.max() > _TURNED_DEG)


def continued(scene: Scene, state: State) -> State:
    """The state with its surface h (c,) moved to explain the light, lamps and materials kept."""
    state = _shining(scene, state, _FINE_SCALE)
    for _ in range(_CONTINUED_STEPS):
        objective = make_objective(scene, state, _FINE_SCALE)
        moved = replace(state, h=_valid(state.h + objective.surface_step(state)))
        state = _shone_on(moved, objective)
    return with_even_albedo(scene, state)


def cost(scene: Scene, state: State) -> float:
    """−2 log posterior of a state but for a constant."""
    return make_objective(scene, state, _SCALES[-1]).cost(state)


def unexplained(scene: Scene, state: State) -> Mask:
    """Pixels (n,) whose light the lamps do not give."""
    return make_objective(scene, state, _LIGHT_SCALE).chi2(state) > _LIGHT_CHI2


def refine(scene: Scene, h: Floats64, found: State) -> State:
    """The surface of a finer scene, lamps and materials as found. h: (c,) where it starts."""
    state = replace(found, h=h)
    state = with_even_albedo(scene, replace(state, lit=facing(scene, state) > 0))
    for _ in range(_FINE_STEPS):
        objective = make_objective(scene, state, _FINE_SCALE, _FINE_STIFFNESS)
        state = _relit(replace(state, h=_valid(state.h + objective.surface_step(state))), objective)
    return state


def _through_shadows(
    scene: Scene, found: tuple[State, float], tick: Tick, rounds: int
) -> tuple[State, float]:
    """The likeliest of what was found and of the surface started anew, lamps as the light says."""
    for again in range(rounds):
        if unexplained(scene, found[0]).mean() < _UNEXPLAINED:
            break
        if not again:
            separated = (_follow_separated(scene, h, tick) for h in _starts(scene))
            found = min([found, *separated], key=_likeliest)
        better = _better(scene, found, tick)
        if better is found:
            break
        found = better
    return found


def _starts(scene: Scene) -> tuple[Floats64, Floats64]:
    return scene.grid.flat(), scene.grid.inflated()


def _likeliest(found: tuple[State, float]) -> float:
    return found[1]


def _follow(scene: Scene, state: State, tick: Tick) -> tuple[State, float]:
    """Follow a start while what counts as an outlier becomes less and less."""
    for scale in _SCALES:
        tick()
        for _ in range(_STEPS):
            objective = make_objective(scene, state, scale)
            state = _relit(_moved(objective, state), objective)
    return state, cost(scene, state)


def _better(scene: Scene, found: tuple[State, float], tick: Tick) -> tuple[State, float]:
    """The likeliest that lamps and materials found lead to, or what was found."""
    starts = *_starts(scene), found[0].h
    again = [_follow_again(scene, found[0], h, tick) for h in starts]
    return min([found, *again], key=_likeliest)


def _follow_again(scene: Scene, found: State, h: Floats64, tick: Tick) -> tuple[State, float]:
    """Follow a start h (c,) with lamps and materials found; lamps shine where the light says so."""
    state = replace(found, h=h * np.median(found.h) / np.median(h))
    state = _shining(scene, state, _SCALES[-1])
    for scale in _SCALES_AGAIN:
        tick()
        for _ in range(_STEPS):
            objective = make_objective(scene, state, scale)
            state = _shone_on(_moved(objective, state), objective)
    return state, cost(scene, state)


def _follow_separated(scene: Scene, h: Floats64, tick: Tick) -> tuple[State, float]:
    """Follow a start h (c,) with the lamps that layers were separated by, materials as is usual."""
    modes = np.stack([prior.found for prior in scene.priors])
    start = replace(_start(scene, h), modes=modes)
    return _follow_on(scene, _follow_again(scene, start, start.h, tick)[0], tick)


def _follow_on(scene: Scene, state: State, tick: Tick) -> tuple[State, float]:
    """Follow a state; lamps shine where surface and light say so."""
    for scale in _SCALES_ON:
        tick()
        for _ in range(_STEPS_ON):
            objective = make_objective(scene, state, scale)
            state = _moved(objective, _relit(state, objective))
    state = _relit(state, make_objective(scene, state, _SCALES_ON[-1]))
    return state, cost(scene, state)


def _shining(scene: Scene, state: State, scale: float) -> State:
    """The state with even albedo, and lamps that shine where the light says so."""
    state = with_even_albedo(scene, state)
    return _shone_on(state, make_objective(scene, state, scale))


def _start(scene: Scene, h: Floats64) -> State:
    """Lamps and materials as is usual, h (c,) scaled to how bright the lamps are."""
    lamps, modes = len(scene.directions), len(scene.priors[0].modes)
    lit = scene.grid.w(h) @ scene.directions.T > 0
    own = np.zeros((len(scene.materials), lamps, 3))
    albedo = np.zeros((scene.segment_count, 3))
    state = State(h, np.zeros((lamps, modes)), own, albedo, np.zeros((lamps, 2)), lit)
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
            state.turns + length * step.turns,
            state.lit,
        )
        if objective.cost(moved) < before:
            break
    return moved


def _valid(h: Floats64) -> Floats64:
    return np.maximum(h, _LEAST_DEPTH * np.median(h))


def _relit(state: State, objective: Objective) -> State:
    """Find anew which lamps light which pixels: those it faces and that are not in its shadow."""
    if objective.scale > _SHADOWS_FROM:
        return replace(state, lit=facing(objective.scene, state) > 0)
    return replace(state, lit=objective.lit(state))


def _shone_on(state: State, objective: Objective) -> State:
    """Find anew which lamps light which pixels: those that the light itself cannot do without."""
    shining = lamp_light(objective.scene, state, objective.precision)
    return replace(state, lit=shining > _DARK * np.median(state.h))
