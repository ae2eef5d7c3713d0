from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from pipeline.frames import Mask
from pipeline.photometric_stereo import parts as parts_module
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


@pytest.fixture
def cut(
    ball: Callable[..., Any], scene_of: Callable[..., Scene], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[Mask, Mask]]:
    """Cut a ball whose fits leave these pixels (H, W) unexplained, the last one ever after.

    Returns what is inside, and what is left.
    """

    def build(*unexplained: Mask) -> tuple[Mask, Mask]:
        left = list(unexplained)

        def off(scene: Scene, _: object) -> Mask:
            pixels: Mask = (left.pop(0) if len(left) > 1 else left[0])[scene.grid.mask]
            return pixels

        monkeypatch.setattr(parts_module, "fit", lambda scene, _: (scene, 0.0))
        monkeypatch.setattr(parts_module, "unexplained", off)
        scene = scene_of(ball(32))
        found: Any = fit_in_parts(scene)
        assert found[1] is found[0]  # the fit of what is left, and of nothing before
        return scene.grid.mask, found[0].grid.mask

    return build


def column(*which: int) -> Mask:
    mask = np.zeros((32, 32), bool)
    mask[:, which] = True
    return mask


NOTHING = column()


def test_what_fits_but_for_a_hundredth_is_not_cut(cut: Callable[..., tuple[Mask, Mask]]) -> None:
    few = NOTHING.copy()
    few[16, 14:20] = True
    inside, left = cut(few)
    assert 0.009 < few[inside].mean() < 0.01
    np.testing.assert_array_equal(left, inside)
    few[17, 14] = True
    inside, left = cut(few)
    assert 0.01 < few[inside].mean() < 0.012
    assert not left[few].any()


def test_a_cut_is_closed_to_a_seam(cut: Callable[..., tuple[Mask, Mask]]) -> None:
    """Three columns fit nowhere; without them all does, and beside a seam of one, too."""
    inside, left = cut(column(15, 16, 17), NOTHING)
    lost = inside & ~left
    middle = inside[:, 15] & inside[:, 17]
    np.testing.assert_array_equal(lost[middle].sum(axis=1), 1)
    assert not lost[:, [*range(14), *range(19, 32)]].any()
    assert ndimage.label(left)[1] == 2


def test_a_thin_bridge_does_not_join_parts(cut: Callable[..., tuple[Mask, Mask]]) -> None:
    bridged = column(15, 16, 17)
    bridged[16] = False
    inside, left = cut(bridged, NOTHING)
    assert ndimage.label(left)[1] == 2
    assert (inside & ~left).sum() == inside[:, 16].sum()


def test_a_narrow_part_at_the_rim_is_one(cut: Callable[..., tuple[Mask, Mask]]) -> None:
    """Two columns wide: it is thin, but no bridge."""
    inside, left = cut(column(4, 5, 6), NOTHING)
    assert ndimage.label(left)[1] == 2
    assert left[:, 2:4][inside[:, 2:4]].all()


@pytest.mark.parametrize(("still", "seam"), [((15,), True), ((14, 15), False)])
def test_a_seam_must_leave_fewer_than_half_unexplained(
    cut: Callable[..., tuple[Mask, Mask]], still: tuple[int, ...], seam: bool
) -> None:
    """Of what a surface without it leaves: three columns."""
    three = column(15, 16, 17)
    inside, left = cut(three, NOTHING, column(*still))
    if seam:
        assert left[three & inside].any()
    else:
        np.testing.assert_array_equal(left, inside & ~three)


def test_there_are_three_cuts_at_most(cut: Callable[..., tuple[Mask, Mask]]) -> None:
    inside, left = cut(*(column(which) for which in (16, 10, 22, 13)))
    np.testing.assert_array_equal(left, inside & ~column(16, 10, 22))


@pytest.mark.parametrize(("wide", "kept"), [(12, True), (10, False)])
def test_a_surface_is_not_cut_to_less_than_half(
    cut: Callable[..., tuple[Mask, Mask]], wide: int, kept: bool
) -> None:
    inside, left = cut(column(*range(16 - wide // 2, 16 + wide // 2)), NOTHING)
    assert bool((left == inside).all()) is kept


def test_cuts_together_leave_half_of_the_surface(cut: Callable[..., tuple[Mask, Mask]]) -> None:
    """The second would leave half of what the first has left."""
    first, second = column(*range(12, 18)), column(*range(18, 25))
    inside, left = cut(first, second)
    np.testing.assert_array_equal(left, inside & ~first)
    assert 0.5 * left.sum() < (left & ~second).sum() < 0.5 * inside.sum()


def test_parts_are_numbered_and_crumbs_are_none() -> None:
    """Two parts that touch at a corner only, and a crumb of a pixel."""
    mask = np.zeros((20, 20), bool)
    mask[:10, :10] = mask[10:, 10:] = mask[2, 15] = True

    parts = parts_of(mask)

    assert parts[2, 15] == 0
    assert set(np.unique(parts)) == {0, parts[0, 0], parts[15, 15]}
    assert parts[0, 0] != parts[15, 15]
    assert (parts > 0).sum() == 200


@pytest.mark.parametrize(("size", "known"), [(1, False), (2, True)])
def test_a_part_has_a_hundredth_of_all(size: int, known: bool) -> None:
    mask = np.zeros((20, 20), bool)
    mask[:10, :15] = mask[15, :size] = True

    assert bool(parts_of(mask)[15, 0]) is known
