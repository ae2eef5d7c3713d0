from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from pipeline.images.frames import Mask
from pipeline.photometric_stereo import growth
from pipeline.photometric_stereo.grid import carried
from pipeline.photometric_stereo.growth import MOST_TICKS, grown
from pipeline.photometric_stereo.scene import Scene, State

SIZE = 32


def rectangle(rows: slice, columns: slice) -> Mask:
    mask = np.zeros((SIZE, SIZE), bool)
    mask[rows, columns] = True
    return mask


EVERY = slice(None)
BAND = rectangle(EVERY, slice(14, 18))


@pytest.fixture
def known(
    ball: Callable[..., Any],
    scene_of: Callable[..., Scene],
    true_state: Callable[..., State],
) -> tuple[Any, Scene, State]:
    """A ball, its scene and its surface."""
    one = ball(SIZE)
    scene = scene_of(one)
    return one, scene, true_state(one, scene)


@pytest.fixture
def grow(
    ball: Callable[..., Any],
    scene_of: Callable[..., Scene],
    true_state: Callable[..., State],
) -> Callable[..., tuple[Any, Scene, State]]:
    """Grow a ball of a known surface from where these pixels (H, W) are cut out.

    flash, light: factors (H, W) on both. Returns the ball and what has grown.
    """

    def build(cut: Mask, flash: Any = 1.0, light: Any = 1.0) -> tuple[Any, Scene, State]:
        one = ball(SIZE)
        of_all = np.ones((SIZE, SIZE))
        other = replace(
            one,
            flash=one.flash * (flash * of_all)[..., None],
            lamps=one.lamps * (light * of_all)[..., None],
        )
        whole = scene_of(other)
        state = true_state(one, scene_of(one))
        kept = whole.without(cut[whole.grid.mask])
        state = replace(state, h=carried(state.h, whole.grid, kept.grid))
        return one, *grown(whole, kept, state)

    return build


def test_parts_grow_to_a_seam_of_one_pixel(
    grow: Callable[..., tuple[Any, Scene, State]],
) -> None:
    one, scene, state = grow(BAND)

    middle = one.inside[:, 13] & one.inside[:, 18]
    lost = one.inside & ~scene.grid.mask
    assert lost[middle].any(axis=1).all()
    assert lost[middle].sum() <= middle.sum() + 2  # where the seam takes a step
    assert ndimage.label(scene.grid.mask, np.ones((3, 3)))[1] == 2
    assert lost.sum() < 0.06 * one.inside.sum()
    within = rectangle(slice(8, 24), slice(14, 18)) & scene.grid.mask
    assert one.error_of(scene, state, within) < 1.5
    assert (state.modes == 0).all()  # lamps and materials as they were
    assert (state.own == 0).all()
    assert len(state.albedo) == scene.segment_count


@pytest.mark.parametrize(
    ("flash", "light"),
    [
        pytest.param(1.0, 1.3, id="brighter"),
        pytest.param(1.3, 1.0, id="nearer to the flash"),
        pytest.param(0.7, 0.7, id="of another albedo"),
    ],
)
def test_what_was_cut_out_comes_to_the_part_that_explains_it(
    grow: Callable[..., tuple[Any, Scene, State]], flash: float, light: float
) -> None:
    """The right half is another surface; all that was cut out beside the jump is its own."""
    right = rectangle(EVERY, slice(16, None))
    factor_of_flash, factor_of_light = (np.where(right, one, 1.0) for one in (flash, light))

    one, scene, state = grow(rectangle(EVERY, slice(16, 21)), factor_of_flash, factor_of_light)

    parts, count = ndimage.label(scene.grid.mask, np.ones((3, 3)))
    assert count == 2
    assert set(np.unique(parts[8:24, 18:])) == {0, parts[16, 24]}
    assert set(np.unique(parts[8:24, :15])) == {0, parts[16, 10]}
    assert one.error_of(scene, state, scene.grid.mask & one.lit) < 1.5


def test_light_that_no_part_explains_comes_to_those_beside_it(
    grow: Callable[..., tuple[Any, Scene, State]],
) -> None:
    """It is left to no one, and does not bend them."""
    patch = rectangle(slice(12, 18), slice(12, 18))

    one, scene, state = grow(patch, 1.0, np.where(patch, 2.0, 1.0))

    np.testing.assert_array_equal(scene.grid.mask, one.inside)
    assert one.error_of(scene, state, one.lit & ~ndimage.binary_dilation(patch, iterations=2)) < 0.5


def test_a_thin_bridge_does_not_join_parts(grow: Callable[..., tuple[Any, Scene, State]]) -> None:
    bridged = BAND & ~rectangle(slice(15, 16), EVERY)

    _, scene, _ = grow(bridged)

    assert ndimage.label(scene.grid.mask, np.ones((3, 3)))[1] == 2


def test_a_small_part_comes_to_the_one_about_it(
    grow: Callable[..., tuple[Any, Scene, State]],
) -> None:
    """No seam stays about an island of nine pixels."""
    about = rectangle(slice(10, 21), slice(10, 21)) & ~rectangle(slice(14, 17), slice(14, 17))

    one, scene, _ = grow(about)

    np.testing.assert_array_equal(scene.grid.mask[8:23, 8:23], one.inside[8:23, 8:23])


def test_nothing_grows_from_small_parts_alone(known: tuple[Any, Scene, State]) -> None:
    one, whole, state = known
    kept = whole.without(~rectangle(slice(14, 17), slice(14, 17))[one.inside])

    assert grown(whole, kept, state) == (kept, state)


def test_it_tells_of_going_on(known: tuple[Any, Scene, State]) -> None:
    _, whole, state = known
    told: list[None] = []

    grown(whole, whole, state, lambda: told.append(None))

    assert len(told) == MOST_TICKS == 3


def test_what_a_part_goes_on_to_smoothly_comes_first(
    known: tuple[Any, Scene, State],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where light tells of no crease, as in shadow, it waits until no part goes on without one."""
    one, whole, true = known
    kept = whole.without(BAND[one.inside])
    state = replace(true, h=carried(true.h, whole.grid, kept.grid))
    creased = np.abs(np.arange(SIZE + 1) - 14) * 0.02 * np.ones((SIZE + 1, 1))

    def continued(scene: Scene, _: State) -> State:
        """The left part bends sharply where the band begins, and all light is explained."""
        h = carried(true.h, whole.grid, scene.grid) + scene.grid.at(creased)
        return replace(true, h=h, albedo=np.zeros((scene.segment_count, 3)))

    monkeypatch.setattr(growth, "continued", continued)
    monkeypatch.setattr(growth, "unexplained", lambda scene, _: np.zeros(len(scene.light), bool))
    monkeypatch.setattr(growth, "albedo_off", lambda scene, _: np.zeros(len(scene.tinted)))

    scene, _ = grown(whole, kept, state)

    taken_by_right = ndimage.label(scene.grid.mask, np.ones((3, 3)))[0]
    assert taken_by_right[16, 15] == taken_by_right[16, 20] != taken_by_right[16, 10]
