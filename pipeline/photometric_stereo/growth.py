"""Parts of a surface grow back into what was cut out about them, as far as they explain the light.

Seeded region growing (Adams and Bischof 1994) with the fit's own test: pixels beside a part are
taken for its continuation, the surface is moved to explain their light, and those it does not
explain are given back. What no part explains comes to the one beside it in the end. Where parts
meet, a seam of one pixel stays: a jump of depth, or a border of shadows that either side ends at.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from pipeline.images.frames import Mask
from pipeline.photometric_stereo.fit import continued, unexplained
from pipeline.photometric_stereo.objective import albedo_off
from pipeline.photometric_stereo.scene import Scene, State, moved_to
from pipeline.photometric_stereo.sides import Parts
from pipeline.progress import Tick

# Chosen on development objects (docs/trials/normals.md)
_LEAST_SEED = 0.05  # of the surface
_BENDS = (0.15, 0.4, np.inf)  # at most, slope per pixel: what a part goes on to smoothly is its own
_MOST_ALBEDO_OFF = 8.0  # standard deviations
_TOUCHING = np.ones((3, 3), dtype=bool)  # pixels that have a corner in common

MOST_TICKS = len(_BENDS)
"""Most calls of tick by grown."""


def grown(
    whole: Scene, kept: Scene, state: State, tick: Tick = lambda: None
) -> tuple[Scene, State]:
    """What is left of a scene, and its surface, when its parts have grown.

    kept: the pixels of whole that state explains; those of thin bridges and small parts are given
    to whichever part grows there. Lamps and materials stay as they are. tick: called as bends that
    a part may make are given more way.
    """
    inside = whole.grid.mask
    parts = _seeds(kept.grid.mask, inside)
    if not parts.any():
        return kept, state
    scene = whole.without(parts[inside] == 0)
    state = continued(scene, moved_to(scene, kept, state))
    for most_bent in _BENDS:
        tick()
        refused: dict[int, Mask] = {}
        while (ring := _ring(parts, inside, refused)).any():
            wider = np.where(ring > 0, ring, parts)
            tried = whole.without(wider[inside] == 0)
            state = continued(tried, moved_to(tried, scene, state))
            off = np.zeros_like(inside)
            off[tried.grid.mask] = _off(tried, state, most_bent)
            for part in np.unique(ring[ring > 0]):
                refused[part] = refused.get(part, False) | (off & (ring == part))
            parts = np.where(off & (ring > 0), 0, wider)
            scene = whole.without(parts[inside] == 0)
            state = moved_to(scene, tried, state)
    # what is beside one part alone is nobody else's
    while (ring := _ring(parts, inside, {})).any():
        parts = np.where(ring > 0, ring, parts)
    filled = whole.without(parts[inside] == 0)
    return filled, continued(filled, moved_to(filled, scene, state))


def _seeds(kept: Mask, whole: Mask) -> Parts:
    """The parts (H, W) to grow, from 1: large ones, without thin bridges between them."""
    parts, _ = ndimage.label(ndimage.binary_erosion(kept | ~whole) & whole)
    parts[np.bincount(parts.ravel())[parts] < _LEAST_SEED * whole.sum()] = 0
    return np.asarray(parts)


def _ring(parts: Parts, whole: Mask, refused: dict[int, Mask]) -> Parts:
    """Which part the pixels beside the parts may come to, so that none come to touch; else 0."""
    ring = np.zeros_like(parts)
    free = whole & (parts == 0)
    for part in np.unique(parts[parts > 0]):
        others = ((parts > 0) & (parts != part)) | (ring > 0)
        may = ndimage.binary_dilation(parts == part) & free & ~refused.get(part, np.False_)
        ring[may & ~ndimage.binary_dilation(others, _TOUCHING)] = part
    return ring


def _off(scene: Scene, state: State, most_bent: float) -> Mask:
    """Pixels (n,) that are not the surface's own: by their light, their albedo, or its bends."""
    grid = scene.grid
    off = unexplained(scene, state)
    off[scene.tinted] |= albedo_off(scene, state) > _MOST_ALBEDO_OFF
    bent = np.zeros(grid.corner_count)
    bends = np.abs(grid.bends(state.h)) / state.h.mean()
    np.maximum.at(bent, grid.bent, bends[:, None])
    return np.asarray(off | (bent[grid.corners].max(axis=1) > most_bent))
