from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.photometric_stereo import fit as fit_module
from pipeline.photometric_stereo.fit import (
    continued,
    fit,
    fit_again,
    fit_on,
    fit_turned,
    refine,
)
from pipeline.photometric_stereo.objective import make_objective
from pipeline.photometric_stereo.scene import Scene, State, directions
from pipeline.vectors import angles_deg


@pytest.mark.parametrize(("materials", "lamps", "limit"), [(1, 3, 0.3), (4, 3, 0.6), (1, 2, 0.4)])
def test_a_ball_is_found(
    ball: Callable[..., Any],
    scene_of: Callable[..., Scene],
    materials: int,
    lamps: int,
    limit: float,
) -> None:
    one = ball(48, materials, lamps)
    scene = scene_of(one)

    state, _ = fit(scene)

    assert one.error_of(scene, state, one.lit) < limit


def test_the_true_order_of_lamps_is_the_likeliest(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    """Even of a ball, which every order of the lamps would make another round body."""
    scene = scene_of(ball(32))
    _, true = fit(scene)

    for order in ((0, 2, 1), (1, 0, 2), (2, 0, 1)):
        swapped = replace(scene, priors=tuple(scene.priors[j] for j in order))
        assert fit(swapped)[1] > true + 5


def test_cast_shadows_are_left_out(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    """A shadow of the first lamp falls on the middle of the ball."""
    one = ball(48)
    shadow = np.zeros(one.inside.shape, bool)
    shadow[18:28, 20:30] = True
    lamps = one.lamps.copy()
    lamps[0][shadow] = 0
    scene = scene_of(replace(one, lamps=lamps))

    state, _ = fit(scene)

    lit = np.zeros(shadow.shape, bool)
    lit[scene.grid.mask] = state.lit[:, 0]
    assert lit[shadow].mean() < 0.05
    assert lit[one.lit & ~shadow].mean() > 0.98
    assert one.error_of(scene, state, shadow) < 1


def test_a_finer_surface_is_found_from_a_coarse_one(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    """With lamps and materials as they are; the start has forgotten every detail."""
    one = ball(48)
    scene = scene_of(one)
    state, _ = fit(scene)
    smooth = np.full_like(state.h, state.h.mean())

    found = refine(scene, smooth, state)

    assert one.error_of(scene, replace(state, h=smooth), one.lit) > 15
    assert one.error_of(scene, found, one.lit) < 1
    np.testing.assert_array_equal(found.modes, state.modes)
    np.testing.assert_array_equal(found.own, state.own)


def off_deg(one: Any, scene: Scene, state: State) -> Floats64:
    return angles_deg((one.directions * directions(scene, state)).sum(axis=1))


@pytest.mark.parametrize(("materials", "most"), [(1, 0.6), (4, 0.8)])
def test_directions_some_degrees_off_are_found(
    ball: Callable[..., Any], scene_of: Callable[..., Scene], materials: int, most: float
) -> None:
    one = ball(32, materials)
    scene = scene_of(one.turned(6))
    state, _ = fit(scene)

    found = fit_turned(scene, state)

    assert off_deg(one, scene, state) == pytest.approx(6)
    assert off_deg(one, scene, found).max() < 1.5
    assert one.error_of(scene, found, one.lit) < most


def test_directions_that_are_right_stay(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    scene = scene_of(ball(32, 4))
    state, _ = fit(scene)

    assert fit_turned(scene, state) is state


def test_equal_scenes_have_equal_surfaces(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    one = ball(24, 2)

    first, second = fit(scene_of(one))[0], fit(scene_of(one))[0]

    np.testing.assert_array_equal(first.h, second.h)


def test_a_wide_shadow_does_not_bend_the_surface(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    """Of the first lamp, over a third of the ball and up to its rim."""
    one = ball(40)
    shadow = np.zeros(one.inside.shape, bool)
    shadow[:, :15] = True
    lamps = one.lamps.copy()
    lamps[0][shadow] = 0
    scene = scene_of(replace(one, lamps=lamps))

    state, _ = fit(scene)

    known = one.lit & shadow
    assert known.sum() > 150
    assert one.error_of(scene, state, known) < 1
    assert one.error_of(scene, state, one.lit & ~shadow) < 0.5


@pytest.mark.parametrize(
    ("shaded", "cost", "taken"), [(True, -1e9, True), (True, 1e9, False), (False, -1e9, False)]
)
def test_lamps_that_layers_were_separated_by_are_a_start_where_light_is_unexplained(
    ball: Callable[..., Any],
    scene_of: Callable[..., Scene],
    true_state: Callable[..., State],
    monkeypatch: pytest.MonkeyPatch,
    shaded: bool,
    cost: float,
    taken: bool,
) -> None:
    """Taken where they lead to what is likelier."""
    one = ball(24)
    scene = scene_of(one)
    starts: list[int] = []
    state = replace(true_state(one, scene), modes=np.full((3, 7), 0.25))

    def separated(_: Scene, h: Floats64, __: object) -> tuple[State, float]:
        starts.append(len(h))
        return state, cost

    monkeypatch.setattr(fit_module, "_follow_separated", separated)
    monkeypatch.setattr(
        fit_module, "unexplained", lambda *_: np.array([0.011 if shaded else 0.009])
    )
    monkeypatch.setattr(fit_module, "_better", lambda _, found, __: found)

    found, _ = fit(scene)

    assert len(starts) == (2 if shaded else 0)
    assert (found is state) is taken


def test_separated_lamps_are_followed_from_their_own_matrices(
    ball: Callable[..., Any], scene_of: Callable[..., Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scene_of(ball(24))
    modes = [np.full(7, value) for value in (0.1, 0.2, 0.3)]
    told = [replace(prior, found=one) for prior, one in zip(scene.priors, modes, strict=True)]
    scene = replace(scene, priors=tuple(told))
    monkeypatch.setattr(fit_module, "_follow_again", lambda _, state, __, ___: (state, 0.0))
    monkeypatch.setattr(fit_module, "_follow_on", lambda _, state, __: (state, 7.0))

    state, cost = fit_module._follow_separated(scene, scene.grid.flat(), lambda: None)

    np.testing.assert_array_equal(state.modes, modes)
    assert cost == 7.0
    assert not state.own.any()


@pytest.mark.parametrize(("left", "cost", "taken"), [(0.06, -1e9, True), (0.04, -1e9, False)])
def test_all_is_fitted_anew_where_lamps_found_leave_much(
    ball: Callable[..., Any],
    scene_of: Callable[..., Scene],
    monkeypatch: pytest.MonkeyPatch,
    left: float,
    cost: float,
    taken: bool,
) -> None:
    """More than a twentieth; else the surface starts anew with lamps and materials as found."""
    one = ball(24)
    scene = scene_of(one)
    found, _ = fit(scene)
    anew = replace(found, modes=found.modes + 1)
    off = np.arange(len(scene.light)) < left * len(scene.light)
    monkeypatch.setattr(fit_module, "unexplained", lambda *_: off)
    monkeypatch.setattr(fit_module, "fit", lambda *_: (anew, cost))
    flat = replace(found, h=np.full_like(found.h, found.h.mean()))

    again = fit_again(scene, flat)

    assert (again is anew) is taken
    assert taken or one.error_of(scene, again, one.lit) < 0.5


def test_a_surface_is_continued_with_lamps_and_materials_kept(
    ball: Callable[..., Any], scene_of: Callable[..., Scene]
) -> None:
    one = ball(24)
    scene = scene_of(one)
    found, _ = fit(scene)
    bent = replace(found, h=found.h * (1 + 0.01 * np.sin(np.arange(len(found.h)))))

    state = continued(scene, bent)

    assert one.error_of(scene, bent, one.lit) > 5
    assert one.error_of(scene, state, one.lit) < 0.5
    assert state.modes is found.modes
    assert state.own is found.own


def test_a_surface_bent_by_a_shadow_is_fitted_on(
    ball: Callable[..., Any], scene_of: Callable[..., Scene], true_state: Callable[..., State]
) -> None:
    """Of the second lamp; what it is fitted on from takes the shadow for a slope."""
    one = ball(32)
    shadow = np.zeros(one.inside.shape, bool)
    shadow[10:20, 8:] = True
    lamps = one.lamps.copy()
    lamps[1][shadow] = 0
    one = replace(one, lamps=lamps)
    scene = scene_of(one)
    lit = scene.grid.w(true_state(one, scene).h) @ scene.directions.T > 0
    bent = replace(true_state(one, scene), lit=lit)
    for _ in range(3):
        step = make_objective(scene, bent, 0.3).surface_step(bent)
        bent = replace(bent, h=bent.h + step)
    known = one.lit | (shadow & one.inside)
    before = one.error_of(scene, bent, known)

    on = fit_on(scene, bent)

    assert before > 3
    assert one.error_of(scene, on, known) < 0.7
    assert on.lit[shadow[one.inside], 1].mean() < 0.02
