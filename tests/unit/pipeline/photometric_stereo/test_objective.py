from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.photometric_stereo.objective import Objective, make_objective, with_even_albedo
from pipeline.photometric_stereo.scene import Scene, State

Array = NDArray[np.float64]


@pytest.fixture
def posed(
    ball: Callable[..., Any], scene_of: Callable[..., Scene], true_state: Callable[..., State]
) -> tuple[Scene, State]:
    """A small painted ball, and a state near the truth."""
    one = ball(24, materials=3)
    scene = scene_of(one)
    state = true_state(one, scene)
    random = np.random.default_rng(2)
    return scene, replace(
        state,
        h=state.h * (1 + 1e-3 * random.standard_normal(len(state.h))),
        modes=0.2 * random.standard_normal(state.modes.shape),
        own=0.2 * random.standard_normal(state.own.shape),
        albedo=state.albedo + 0.01 * random.standard_normal(state.albedo.shape),
    )


def added(state: State, change: State, length: float) -> State:
    return State(
        state.h + length * change.h,
        state.modes + length * change.modes,
        state.own + length * change.own,
        state.albedo + length * change.albedo,
        state.lit,
    )


@pytest.mark.parametrize("scale", [0.3, 0.01])
def test_a_step_leads_downhill(posed: tuple[Scene, State], scale: float) -> None:
    scene, state = posed
    objective = make_objective(scene, state, scale)

    step = objective.step(state)

    assert objective.cost(added(state, step, 0.02)) < objective.cost(state)
    assert objective.cost(added(state, step, -0.02)) > objective.cost(state)


@pytest.mark.parametrize("part", ["h", "modes", "own", "albedo"])
def test_steps_end_where_no_unknown_gains(posed: tuple[Scene, State], part: str) -> None:
    """The optimum is one of the cost itself: no unknown of any kind lowers it by more."""
    scene, state = posed
    objective = make_objective(scene, state, 0.3)
    for _ in range(60):
        state = added(state, objective.step(state), 0.5)
    lowest = objective.cost(state)
    random = np.random.default_rng(4)
    values = getattr(state, part)

    for _ in range(12):
        change = np.zeros(values.size)
        change[random.integers(values.size)] = 1e-3
        for sign in (1, -1):
            moved = replace(state, **{part: values + sign * change.reshape(values.shape)})
            assert objective.cost(moved) > lowest - 1e-4


def test_a_step_of_the_surface_alone_leads_downhill(posed: tuple[Scene, State]) -> None:
    scene, state = posed
    objective = make_objective(scene, state, 0.05)

    moved = replace(state, h=state.h + 0.1 * objective.surface_step(state))

    assert objective.cost(moved) < objective.cost(state)


def test_stiffness_counts_bends_alone(posed: tuple[Scene, State]) -> None:
    scene, state = posed
    costs = [make_objective(scene, state, 0.05, stiffness).cost(state) for stiffness in (0, 1, 2)]

    assert costs[2] - costs[1] == pytest.approx(costs[1] - costs[0])
    assert costs[1] > costs[0]


def test_what_is_left_over_counts_less_the_coarser_the_scale(posed: tuple[Scene, State]) -> None:
    scene, state = posed
    chi2 = [make_objective(scene, state, scale).chi2(state).sum() for scale in (0.3, 0.03)]

    assert chi2[0] < 0.05 * chi2[1]


def test_albedo_is_even_in_every_segment(posed: tuple[Scene, State]) -> None:
    """Doubling a segment's flash part doubles its albedo."""
    scene, state = posed
    even = with_even_albedo(scene, state)
    brighter = scene.flash.copy()
    brighter[scene.segments == 1] *= 2

    moved = with_even_albedo(replace(scene, flash=brighter), state)

    difference = moved.albedo[:, 0] - even.albedo[:, 0]
    np.testing.assert_allclose(difference[1], np.log(2), rtol=1e-9)
    np.testing.assert_allclose(np.delete(difference, 1), 0, atol=1e-9)
    assert (even.albedo[:, 1:] == 0).all()


def test_a_surface_of_crumbs_has_no_segments_and_is_solved(
    ball: Callable[..., Any], scene_of: Callable[..., Scene], true_state: Callable[..., State]
) -> None:
    one = ball(24)
    crumbs = one.inside.copy()
    crumbs[::3] = crumbs[:, ::3] = False
    scene = scene_of(replace(one, inside=crumbs))
    state = true_state(replace(one, inside=crumbs), scene)

    objective: Objective = make_objective(scene, state, 0.1)
    step = objective.step(state)

    assert scene.segment_count == 0
    assert np.isfinite(step.h).all()
    assert objective.cost(added(state, step, 0.05)) < objective.cost(state)
