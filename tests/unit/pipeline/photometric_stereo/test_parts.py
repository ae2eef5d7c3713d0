from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import ndimage

from pipeline.photometric_stereo.fit import fit
from pipeline.photometric_stereo.parts import fit_in_parts, parts_of
from pipeline.photometric_stereo.scene import Scene


def test_a_continuous_surface_stays_in_one_piece(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    scene = scene_of(ball(24, 3))

    left, state = fit_in_parts(scene)

    assert left is scene
    np.testing.assert_array_equal(state.h, fit(scene)[0].h)


def test_light_that_no_lamp_gives_is_cut_out(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    """A scratch across the ball in wrong colours, two pixels wide; a seam is one pixel wide."""
    one = ball(40)
    scratch = np.zeros(one.inside.shape, bool)
    scratch[19:21] = True
    lamps = np.where(scratch[..., None], 0.3 * one.lamps[:, :, ::-1], one.lamps)
    scene = scene_of(replace(one, lamps=lamps))

    left, state = fit_in_parts(scene)

    assert left.grid.mask[scratch].sum() <= 0.5 * one.inside[scratch].sum()
    assert ndimage.label(left.grid.mask)[1] == 2
    assert left.grid.mask[~scratch].sum() > 0.9 * one.inside[~scratch].sum()
    assert one.error_of(left, state, one.lit & left.grid.mask & ~scratch) < 1


def test_parts_are_numbered_and_crumbs_are_none() -> None:
    """Two parts that touch at a corner only, and a crumb of a pixel."""
    mask = np.zeros((20, 20), bool)
    mask[:10, :10] = mask[10:, 10:] = mask[2, 15] = True

    parts = parts_of(mask)

    assert parts[2, 15] == 0
    assert set(np.unique(parts)) == {0, parts[0, 0], parts[15, 15]}
    assert parts[0, 0] != parts[15, 15]
    assert (parts > 0).sum() == 200
