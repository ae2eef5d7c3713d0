"""A surface in parts, where depth jumps: a jump is no slope, and no continuous surface has it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.images.frames import Mask
from pipeline.photometric_stereo.fit import MOST_TICKS as _OF_FIT
from pipeline.photometric_stereo.fit import (
    MOST_TICKS_AGAIN,
    MOST_TICKS_ON,
    MOST_TICKS_WHOLE,
    cost,
    fit,
    fit_again,
    fit_on,
    fit_whole,
    unexplained,
)
from pipeline.photometric_stereo.growth import MOST_TICKS as _OF_GROWTH
from pipeline.photometric_stereo.growth import grown
from pipeline.photometric_stereo.objective import with_even_albedo
from pipeline.photometric_stereo.scene import Scene, State, moved_to
from pipeline.photometric_stereo.sides import jumps
from pipeline.progress import Tick

_MOST_CUTS, _LEAST_CUT = 3, 0.01
_MANY = 0.05  # unexplained pixels of a surface without cuts: so many are no chance
_ROUNDS = 3  # of fitting all and growing anew
_LEFT_OUT = 100.0  # −2 log likelihood of a pixel that a surface has no part of
_LEAST_PART, _LEAST_LEFT = 0.01, 0.5  # of the surface

MOST_TICKS = MOST_TICKS_WHOLE + _OF_FIT + _MOST_CUTS * MOST_TICKS_AGAIN + _OF_GROWTH
MOST_TICKS += _ROUNDS * (MOST_TICKS_ON + _OF_GROWTH)
"""Most calls of tick by fit_in_parts."""


def fit_in_parts(scene: Scene, tick: Tick = lambda: None) -> tuple[Scene, State]:
    """The likeliest surface of a scene, cut where no continuous one explains the light.

    A jump of depth leaves pixels beside it that no lamp explains. Without them its sides hang
    together no longer, and each finds its own distance by the fall-off of the flash, with lamps and
    materials as found so far: what is left bends them less and less. Where the first fit is bent
    too much to tell jumps, the pair itself does: cut there and fitted from the start it may be
    likelier. Then the parts grow back, all is fitted on, and what is not explained then grows anew.
    The likeliest on the way is returned, with what is left of the scene; or the surface without
    cuts, where it leaves few pixels unexplained and is likelier on those of the other. tick: as of
    fit.
    """
    whole, uncut = scene, fit_whole(scene, tick)[0]
    state, found, cuts = uncut, [], 0
    least = _LEAST_LEFT * len(whole.light)
    while unexplained(scene, state).mean() > _LEAST_CUT and cuts < _MOST_CUTS:
        less, ways = _explained(scene, state), []
        if len(less.light) >= least:
            ways.append((less, fit_again(less, moved_to(less, scene, state), tick)))
        if not cuts and not any(unexplained(*way).mean() <= _LEAST_CUT for way in ways):
            apart = _apart(whole)
            if least <= len(apart.light) < len(whole.light):
                ways.append((apart, fit(apart, tick)[0]))
        if not ways:
            break
        scene, state = min(ways, key=_likeliest)
        cuts += 1
    if not cuts:
        return scene, state
    found.append((scene, state))
    for again in range(1 + _ROUNDS):
        if again:
            state = fit_on(scene, state, tick)
            found.append((scene, state))
            less = _explained(scene, state)
            scene, state = less, _within(less, scene, state)
        # most of what was cut out belongs to one side or the other
        scene, state = grown(whole, scene, state, tick)
        found.append((scene, state))
    scene, state = min(found, key=_likeliest)
    few = unexplained(whole, uncut).mean() < _MANY
    if few and cost(scene, _within(scene, whole, uncut)) < cost(scene, state):
        return whole, uncut
    return scene, state


def _likeliest(found: tuple[Scene, State]) -> float:
    return cost(*found) - _LEFT_OUT * len(found[0].light)


def _apart(scene: Scene) -> Scene:
    """The scene without the pixels beside which depth may jump, and without crumbs."""
    mask = scene.grid.mask
    flash, light = np.zeros(mask.shape), np.zeros(mask.shape)
    flash[mask], light[mask] = scene.total, scene.light.sum(axis=1)
    return scene.without(parts_of(mask & ~jumps(flash, light, mask))[mask] == 0)


def _explained(scene: Scene, state: State) -> Scene:
    """The scene without the pixels whose light is not explained, and without crumbs."""
    mask = scene.grid.mask.copy()
    mask[mask] = ~unexplained(scene, state)
    return scene.without(parts_of(mask)[scene.grid.mask] == 0)


def _within(scene: Scene, whole: Scene, state: State) -> State:
    """The state of a whole scene as that of some of its pixels."""
    lit = state.lit[scene.grid.mask[whole.grid.mask]]
    return with_even_albedo(scene, replace(moved_to(scene, whole, state), lit=lit))


def parts_of(mask: Mask) -> NDArray[np.intp]:
    """Number the parts (H, W) of a mask that hang together, from 1; 0 outside and in crumbs."""
    parts, _ = ndimage.label(mask)
    sizes = np.bincount(parts.ravel())
    parts[sizes[parts] < _LEAST_PART * mask.sum()] = 0
    return np.asarray(parts)
