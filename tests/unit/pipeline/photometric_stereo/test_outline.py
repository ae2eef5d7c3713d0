from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.images.frames import Mask
from pipeline.photometric_stereo.outline import turns_away

RADIUS = 40.0


def egg(middle: tuple[float, float] = (60.0, 60.0)) -> tuple[Mask, Floats64]:
    """An egg, 120 × 120: where it is, and its normals of some length."""
    y, x = np.indices((120, 120), dtype=np.float64)
    right, up = (x - middle[0]) / RADIUS, (middle[1] - y) / (0.8 * RADIUS)
    left = 1 - right**2 - up**2
    mask = left > 0
    w = np.stack([right, up / 0.8, np.sqrt(np.maximum(left, 0))], axis=2) * mask[..., None]
    return mask, 3.0 * w


def test_a_round_thing_turns_away_and_its_mould_does_not() -> None:
    mask, w = egg()

    away = turns_away(mask, w)

    assert 0.35 < away < 0.5
    assert turns_away(mask, w * [-1, -1, 1]) < -0.35


@pytest.mark.parametrize("axis", [0, 1])
def test_inside_out_along_one_axis_is_enough(axis: int) -> None:
    mask, w = egg()
    w[..., axis] *= -1

    assert turns_away(mask, w) < -0.3


def test_a_face_that_looks_at_the_camera_does_neither() -> None:
    mask, _ = egg()

    assert turns_away(mask, np.where(mask[..., None], [0.0, 0.0, 2.0], 0.0)) == 0


def test_gaps_and_the_border_of_the_picture_are_no_outline() -> None:
    """Around a gap on an egg's bright side normals point into it."""
    mask, w = egg()
    y, x = np.indices(mask.shape)
    gap = np.hypot(x - 60, y - 60) < 20

    assert turns_away(mask & ~gap, w * ~gap[..., None]) == pytest.approx(turns_away(mask, w))
    assert turns_away(np.ones_like(mask), np.broadcast_to([0.0, 0.6, 0.8], (*mask.shape, 3))) == 0
    beyond = egg((0.0, 60.0))
    assert turns_away(*beyond) > 0.1


@pytest.mark.parametrize(("radius", "tells"), [(13.0, False), (14.0, True)])
def test_a_short_outline_tells_nothing(radius: float, tells: bool) -> None:
    """A dent in a disc."""
    y, x = np.indices((60, 60)) - 30.0
    mask = np.hypot(x, y) <= radius
    w = np.dstack([-x, y, np.full_like(x, radius)])

    assert (turns_away(mask, w) < -0.1) == tells
