"""A surface in parts, where depth jumps: a jump is no slope, and no continuous surface has it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.frames import Mask
from pipeline.photometric_stereo.fit import MOST_TICKS as _OF_FIT
from pipeline.photometric_stereo.fit import fit, unexplained
from pipeline.photometric_stereo.scene import Scene, State
from pipeline.progress import Tick

_MOST_CUTS, _LEAST_CUT = 3, 0.01
_FEWER = 0.5  # of the pixels that a surface without seams leaves unexplained
_LEAST_PART, _LEAST_LEFT = 0.01, 0.5  # of the surface

MOST_TICKS = (1 + _MOST_CUTS + 1) * _OF_FIT
"""Times that fit_in_parts tells of going on, at most."""


def fit_in_parts(scene: Scene, tick: Tick = lambda: None) -> tuple[Scene, State]:
    """The likeliest surface of a scene, cut where no continuous one explains the light.

    A jump of depth leaves pixels beside it that no lamp explains. Without them its sides hang
    together no longer, and each finds its own distance by the fall-off of the flash. Returns what
    is left of the scene as well. tick: as of fit.
    """
    state, _ = fit(scene, tick)
    whole, off, cuts = scene, unexplained(scene, state), 0
    many = _FEWER * off.mean()
    while off.mean() > _LEAST_CUT and cuts < _MOST_CUTS:
        mask = scene.grid.mask.copy()
        mask[mask] = ~off
        left = parts_of(mask) > 0
        if left.sum() < _LEAST_LEFT * len(whole.light):
            break
        scene, cuts = scene.without(~left[scene.grid.mask]), cuts + 1
        state, _ = fit(scene, tick)
        off = unexplained(scene, state)
    if not cuts:
        return scene, state
    # most of what was cut out belongs to one side or the other
    seams = _seams(whole.grid.mask, scene.grid.mask)
    seamed = whole.without(seams[whole.grid.mask])
    found, _ = fit(seamed, tick)
    return (seamed, found) if unexplained(seamed, found).mean() < many else (scene, state)


def parts_of(mask: Mask) -> NDArray[np.intp]:
    """Number the parts (H, W) of a mask that hang together, from 1; 0 outside and in crumbs."""
    parts, _ = ndimage.label(mask)
    sizes = np.bincount(parts.ravel())
    parts[sizes[parts] < _LEAST_PART * mask.sum()] = 0
    return np.asarray(parts)


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
        seams[ahead] |= (widened[ahead] != widened[behind]) & (widened[behind] > 0)
    return seams
