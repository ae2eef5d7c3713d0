"""A surface in parts, where depth jumps: a jump is no slope, and no continuous surface has it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.frames import Mask
from pipeline.photometric_stereo.fit import MOST_TICKS as _OF_FIT
from pipeline.photometric_stereo.fit import MOST_TICKS_AGAIN, cost, fit, fit_again, unexplained
from pipeline.photometric_stereo.growth import MOST_TICKS as _OF_GROWTH
from pipeline.photometric_stereo.growth import grown
from pipeline.photometric_stereo.objective import with_even_albedo
from pipeline.photometric_stereo.scene import Scene, State, moved_to
from pipeline.progress import Tick

_MOST_CUTS, _LEAST_CUT = 3, 0.01
_MANY = 0.05  # unexplained pixels of a surface without cuts: so many are no chance
_FEWER = 0.5  # of them
_LEAST_PART, _LEAST_LEFT = 0.01, 0.5  # of the surface

MOST_TICKS = _OF_FIT + _MOST_CUTS * MOST_TICKS_AGAIN + _OF_GROWTH
"""Times that fit_in_parts tells of going on, at most."""


def fit_in_parts(scene: Scene, tick: Tick = lambda: None) -> tuple[Scene, State]:
    """The likeliest surface of a scene, cut where no continuous one explains the light.

    A jump of depth leaves pixels beside it that no lamp explains. Without them its sides hang
    together no longer, and each finds its own distance by the fall-off of the flash, with lamps and
    materials as found so far: what is left bends them less and less. Where a surface without cuts
    leaves few pixels unexplained and is likelier, it stays. Returns what is left of the scene as
    well. tick: as of fit.
    """
    whole, (uncut, _) = scene, fit(scene, tick)
    state, off, cuts = uncut, unexplained(scene, uncut), 0
    many = float(off.mean())
    while off.mean() > _LEAST_CUT and cuts < _MOST_CUTS:
        mask = scene.grid.mask.copy()
        mask[mask] = ~off
        left = parts_of(mask) > 0
        if left.sum() < _LEAST_LEFT * len(whole.light):
            break
        less, cuts = scene.without(~left[scene.grid.mask]), cuts + 1
        scene, state = less, fit_again(less, moved_to(less, scene, state), tick)
        off = unexplained(scene, state)
    if not cuts:
        return scene, state
    # most of what was cut out belongs to one side or the other
    again, found = grown(whole, scene, state, tick)
    if many < _MANY and cost(again, found) > cost(again, _within(again, whole, uncut)):
        return whole, uncut
    return (again, found) if unexplained(again, found).mean() < _FEWER * many else (scene, state)


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
