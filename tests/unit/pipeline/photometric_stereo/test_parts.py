from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from pipeline.images.frames import Mask
from pipeline.photometric_stereo import parts as parts_module
from pipeline.photometric_stereo.fit import fit, unexplained
from pipeline.photometric_stereo.parts import fit_in_parts, parts_of
from pipeline.photometric_stereo.scene import Scene, State, directions
from pipeline.vectors import angles_deg
from tests.ball import before_a_wall


def test_a_continuous_surface_stays_in_one_piece(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    scene = scene_of(ball(24, 3))

    left, state = fit_in_parts(scene)

    assert left is scene
    np.testing.assert_array_equal(state.h, fit(scene)[0].h)


def test_directions_far_off_are_found_before_anything_is_cut(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    """By 25 degrees, which leave light unexplained as jumps do."""
    one = ball(32, 4)
    scene = scene_of(one.turned(25))

    left, state = fit_in_parts(scene)

    assert unexplained(scene, fit(scene, rounds=0)[0]).mean() > 0.05
    assert left is scene
    assert angles_deg((one.directions * directions(scene, state)).sum(axis=1)).max() < 2
    assert one.error_of(scene, state, one.lit) < 1


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


@pytest.mark.parametrize("ratio", [1.15, 0.8])
def test_either_side_of_a_jump_finds_its_own_distance(
    ball: Callable[..., Any], scene_of: Callable[..., Scene], ratio: float
) -> None:
    """The right half of a ball is farther or nearer, and larger or smaller, than the left one.

    It looks the same, but for the light of the flash.
    """
    one = ball(32)
    right = np.arange(32) >= 18
    scene = scene_of(replace(one, flash=one.flash / np.where(right, ratio**2, 1)[:, None]))

    left, state = fit_in_parts(scene)

    assert left.grid.mask.sum() > 0.94 * one.inside.sum()
    assert one.error_of(left, state, one.lit & left.grid.mask) < 1
    depth = np.full(one.inside.shape, np.nan)
    depth[left.grid.mask] = np.sqrt(state.h[left.grid.corners].mean(axis=1))
    relative = depth / one.depth
    middle = np.s_[10:22]
    beyond, before = (np.nanmedian(relative[middle, at]) for at in (slice(20, 25), slice(11, 16)))
    assert beyond / before == pytest.approx(ratio, rel=0.01)


def test_a_thing_before_a_wall_does_not_bend_it(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    """It hides part of the wall and casts three shadows on it, which no one surface explains."""
    one = before_a_wall(ball(32))
    scene = scene_of(one)

    left, state = fit_in_parts(scene)

    assert left.grid.mask.mean() > 0.9
    assert one.error_of(left, state, one.lit & left.grid.mask) < 1


@pytest.fixture
def cut(
    ball: Callable[..., Any],
    scene_of: Callable[..., Scene],
    true_state: Callable[..., State],
    monkeypatch: pytest.MonkeyPatch,
) -> Callable[..., tuple[Mask, Mask]]:
    """Cut a ball whose fits leave these pixels (H, W) unexplained, the last one ever after.

    grows: whether what is cut grows back whole. uncut_cost: of the surface without cuts, as far as
    others go. grown_cost: of what has grown back. Returns what is inside, and what is left.
    """

    def build(
        *unexplained: Mask, grows: bool = True, uncut_cost: float = 1.0, grown_cost: float = 0.0
    ) -> tuple[Mask, Mask]:
        one, last = ball(32), len(unexplained) - 1
        scene = scene_of(one)
        state = true_state(one, scene)
        cuts: list[Scene] = []
        depth = np.zeros(scene.grid.corner_mask.shape)
        depth[scene.grid.corner_mask] = state.h

        def off(scene: Scene, found: State) -> Mask:
            pixels: Mask = unexplained[0 if found is state else min(len(cuts), last)]
            return pixels[scene.grid.mask]

        def fit_again(less: Scene, found: State, _: object) -> State:
            """The surface is carried over, lamps and materials go on as found."""
            np.testing.assert_allclose(found.h, less.grid.at(depth))
            np.testing.assert_allclose(found.modes, state.modes, atol=1e-6)
            assert found.own is state.own
            cuts.append(less)
            lit = np.ones((len(less.light), len(found.modes)), bool)
            return replace(found, modes=found.modes + 1e-9, lit=lit)

        def grown(whole: Scene, kept: Scene, found: State, _: object) -> tuple[Scene, State]:
            assert whole is scene
            return (whole, replace(state, modes=found.modes)) if grows else (kept, found)

        def cost(at: Scene, found: State) -> float:
            if np.array_equal(found.modes, state.modes):
                return uncut_cost
            return grown_cost if at is scene else 0.0

        for name in ("fit", "fit_whole"):
            monkeypatch.setattr(parts_module, name, lambda *_: (state, 0.0))
        monkeypatch.setattr(parts_module, "_apart", lambda whole: whole)
        monkeypatch.setattr(parts_module, "fit_again", fit_again)
        monkeypatch.setattr(parts_module, "fit_on", lambda _, found, __: found)
        monkeypatch.setattr(parts_module, "unexplained", off)
        monkeypatch.setattr(parts_module, "grown", grown)
        monkeypatch.setattr(parts_module, "cost", cost)
        found, _ = fit_in_parts(scene)
        return scene.grid.mask, found.grid.mask

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
    inside, left = cut(few, grows=False)
    assert 0.01 < few[inside].mean() < 0.012
    assert not left[few].any()


@pytest.mark.parametrize(("cost", "stays"), [(99.0, False), (101.0, True)])
def test_what_grows_back_must_be_likelier_than_pixels_left_out(
    cut: Callable[..., tuple[Mask, Mask]], cost: float, stays: bool
) -> None:
    """A pixel that no surface has a part of costs 100."""
    one = NOTHING.copy()
    one[15, 4:28] = True
    inside, left = cut(one, NOTHING, grown_cost=cost * one.sum())
    np.testing.assert_array_equal(left, inside & ~one if stays else inside)


@pytest.mark.parametrize(("columns", "stays"), [((15,), True), ((15, 16), False)])
@pytest.mark.parametrize("uncut_cost", [-1.0, 1.0])
def test_a_likelier_surface_without_cuts_stays_where_it_explains_most(
    cut: Callable[..., tuple[Mask, Mask]], columns: tuple[int, ...], stays: bool, uncut_cost: float
) -> None:
    """All but a twentieth; of more, what it does not explain is no chance."""
    few = column(*columns)
    inside, left = cut(few, NOTHING, grows=False, uncut_cost=uncut_cost)
    assert bool(few[inside].mean() < 0.05) is stays
    stays = stays and uncut_cost < 0
    np.testing.assert_array_equal(left, inside if stays else inside & ~few)


def test_there_are_three_cuts_at_most(cut: Callable[..., tuple[Mask, Mask]]) -> None:
    inside, left = cut(*(column(which) for which in (16, 10, 22, 13)), grows=False)
    np.testing.assert_array_equal(left, inside & ~column(16, 10, 22))


@pytest.mark.parametrize(("wide", "kept"), [(12, True), (10, False)])
def test_a_surface_is_not_cut_to_less_than_half(
    cut: Callable[..., tuple[Mask, Mask]], wide: int, kept: bool
) -> None:
    inside, left = cut(column(*range(16 - wide // 2, 16 + wide // 2)), NOTHING, grows=False)
    assert bool((left == inside).all()) is kept


def test_cuts_together_leave_half_of_the_surface(cut: Callable[..., tuple[Mask, Mask]]) -> None:
    """The second would leave half of what the first has left."""
    first, second = column(*range(12, 18)), column(*range(18, 25))
    inside, left = cut(first, second, grows=False)
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


@pytest.mark.parametrize("costs", [(9.0, 5.0, 7.0), (9.0, 7.0, 5.0), (5.0, 7.0, 9.0)])
def test_the_likeliest_of_three_rounds_is_taken(
    ball: Callable[..., Any],
    scene_of: Callable[..., Scene],
    true_state: Callable[..., State],
    monkeypatch: pytest.MonkeyPatch,
    costs: tuple[float, ...],
) -> None:
    """Each fits on from what the one before came to; first modes tell how often that was."""
    one = ball(24)
    scene = scene_of(one)
    state = true_state(one, scene)

    def round_of(found: State) -> int:
        return round(float(found.modes[0, 0]))

    def off(scene: Scene, found: State) -> Mask:
        return (np.arange(len(scene.light)) < 0.2 * len(scene.light)) & (found is state)

    def fit_again(less: Scene, found: State, _: object) -> State:
        return replace(found, modes=found.modes * 0, lit=np.ones((len(less.light), 3), bool))

    for name in ("fit", "fit_whole"):
        monkeypatch.setattr(parts_module, name, lambda *_: (state, 0.0))
    monkeypatch.setattr(parts_module, "fit_again", fit_again)
    monkeypatch.setattr(
        parts_module, "fit_on", lambda _, found, __: replace(found, modes=found.modes + 1)
    )
    monkeypatch.setattr(parts_module, "unexplained", off)
    monkeypatch.setattr(parts_module, "grown", lambda _, kept, found, __: (kept, found))
    monkeypatch.setattr(parts_module, "cost", lambda _, found: (20.0, *costs)[round_of(found)])

    _, found = fit_in_parts(scene)

    assert round_of(found) == 1 + costs.index(5.0)
