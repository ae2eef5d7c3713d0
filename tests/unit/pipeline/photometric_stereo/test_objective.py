from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.photometric_stereo.objective import Objective, make_objective, with_even_albedo
from pipeline.photometric_stereo.scene import Scene, State, facing, predicted

_UNKNOWNS = ("h", "modes", "own", "albedo", "turns")


@pytest.fixture
def posed(
    ball: Callable[..., Any], scene_of: Callable[..., Scene], true_state: Callable[..., State]
) -> tuple[Scene, State]:
    """A small painted ball, and a state near the truth."""
    one = ball(24, materials=3)
    scene = scene_of(one)
    state = true_state(one, scene)
    random = np.random.default_rng(2)
    return replace(scene, turning=True), replace(
        state,
        h=state.h * (1 + 1e-3 * random.standard_normal(len(state.h))),
        modes=0.2 * random.standard_normal(state.modes.shape),
        own=0.2 * random.standard_normal(state.own.shape),
        albedo=state.albedo + 0.01 * random.standard_normal(state.albedo.shape),
        turns=0.2 * random.standard_normal(state.turns.shape),
    )


def added(state: State, change: State, length: float) -> State:
    return State(
        state.h + length * change.h,
        state.modes + length * change.modes,
        state.own + length * change.own,
        state.albedo + length * change.albedo,
        state.turns + length * change.turns,
        state.lit,
    )


@pytest.fixture
def even(posed: tuple[Scene, State]) -> tuple[Scene, State]:
    """The same with a flash part by which every pixel has an albedo of 1."""
    scene, state = posed
    length = np.linalg.norm(scene.grid.w(state.h), axis=1)
    flash = scene.flash / (scene.total * length)[:, None]
    return replace(scene, flash=flash), replace(state, albedo=np.zeros_like(state.albedo))


@pytest.mark.parametrize("scale", [0.3, 0.01])
def test_a_step_leads_downhill(posed: tuple[Scene, State], scale: float) -> None:
    scene, state = posed
    objective = make_objective(scene, state, scale)

    step = objective.step(state)

    assert objective.cost(added(state, step, 0.02)) < objective.cost(state)
    assert objective.cost(added(state, step, -0.02)) > objective.cost(state)


def test_steps_end_where_no_unknown_gains(posed: tuple[Scene, State]) -> None:
    """The optimum is one of the cost itself: no unknown of any kind lowers it by more."""
    scene, state = posed
    objective = make_objective(scene, state, 0.3)
    for _ in range(60):
        state = added(state, objective.step(state), 0.5)
    lowest = objective.cost(state)

    for part in _UNKNOWNS:
        random = np.random.default_rng(4)
        values = getattr(state, part)
        for _ in range(12):
            change = np.zeros(values.size)
            change[random.integers(values.size)] = 1e-3
            for sign in (1, -1):
                moved = replace(state, **{part: values + sign * change.reshape(values.shape)})
                assert objective.cost(moved) > lowest - 1e-4, part


def test_a_step_solves_the_normal_equations(posed: tuple[Scene, State]) -> None:
    """Those of residuals whose derivatives are measured, each weighed by what it counts."""
    scene, state = posed
    objective = make_objective(scene, state, 0.05)

    step, alone = objective.step(state), objective.surface_step(state)

    residuals, weights, derivatives = linearised(objective, state)
    normal = derivatives.T @ (weights[:, None] * derivatives)
    downhill = -derivatives.T @ (weights * residuals)
    exact = unpacked(state, np.asarray(np.linalg.solve(normal, downhill)))
    for part in _UNKNOWNS:
        size = np.abs(getattr(exact, part)).max()
        assert getattr(step, part) == pytest.approx(getattr(exact, part), abs=1e-3 * size), part
    own = slice(0, len(state.h))
    expected = np.linalg.solve(normal[own, own], downhill[own])
    assert alone == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


def unpacked(state: State, values: Floats64) -> State:
    """A change of all unknowns of a state, from one row of them."""
    parts = [getattr(state, name) for name in _UNKNOWNS]
    pieces = np.split(values, np.cumsum([part.size for part in parts])[:-1])
    h, modes, own, albedo, turns = (
        piece.reshape(part.shape) for piece, part in zip(pieces, parts, strict=True)
    )
    return State(h, modes, own, albedo, turns, state.lit)


def linearised(objective: Objective, state: State) -> tuple[Floats64, Floats64, Floats64]:
    """Residuals, the weights that robustness leaves them, and derivatives by all unknowns."""
    scene, sigma, mean = objective.scene, objective.albedo_sigma, state.h.mean()

    def residuals(at: State) -> Floats64:
        length = np.linalg.norm(scene.grid.w(at.h)[scene.tinted], axis=1)
        level = (at.albedo[scene.segments[scene.tinted]] * scene.tints).sum(axis=1)
        return np.concatenate(
            [
                (predicted(scene, at) - scene.light).ravel(),
                np.log(scene.total[scene.tinted] * length) - level,
                scene.grid.bends(at.h) / mean,
                at.modes.ravel(),
                at.own.ravel(),
                at.albedo[:, 1:].ravel() / 5,
                at.turns.ravel(),
            ]
        )

    here = residuals(state)
    light, albedo, bends = np.split(
        here[: scene.light.size + len(scene.tinted) + len(scene.grid.bent)],
        np.cumsum([scene.light.size, len(scene.tinted)]),
    )
    precision = objective.precision.ravel()
    weights = np.ones_like(here)
    weights[: len(light) + len(albedo) + len(bends)] = np.concatenate(
        [
            precision / (1 + light**2 * precision / 9),
            scene.tint_weights / (sigma**2 + albedo**2 / 4),
            0.36 / (0.1**2 + bends**2),
        ]
    )
    columns = []
    size = sum(getattr(state, name).size for name in _UNKNOWNS)
    for i in range(size):
        change = unpacked(state, 1e-5 * np.eye(1, size, i)[0])
        ahead, behind = (residuals(added(state, change, length)) for length in (1.0, -1.0))
        columns.append((ahead - behind) / 2e-5)
    return here, weights, np.stack(columns, axis=1)


def test_lamps_that_may_not_turn_stay(posed: tuple[Scene, State]) -> None:
    scene, state = posed

    step = make_objective(replace(scene, turning=False), state, 0.05).step(state)

    assert not step.turns.any()
    assert step.modes.any()


def test_light_that_is_off_costs_less_than_its_square(posed: tuple[Scene, State]) -> None:
    """Nine times ln(1 + χ²/9): 9 ln 2 at three standard deviations, of one channel."""
    scene, state = posed
    objective = make_objective(scene, state, 0.05)
    costs = []
    for deviations in (0.0, 3.0):
        light = scene.light.copy()
        light[50] = predicted(scene, state)[50]
        light[50, 1] += deviations / np.sqrt(objective.precision[50, 1])
        costs.append(replace(objective, scene=replace(scene, light=light)).cost(state))

    assert costs[1] - costs[0] == pytest.approx(9 * np.log(2))


def test_usual_lamps_materials_and_tints_cost_their_square(even: tuple[Scene, State]) -> None:
    """Where nothing else counts, by the deviation of each: of tints that is 5."""
    scene, state = even
    objective = make_objective(scene, state, 0.05)
    objective = replace(objective, precision=0 * objective.precision, albedo_sigma=1e6)
    none = replace(state, modes=0 * state.modes, own=0 * state.own, turns=0 * state.turns)
    for part, size, cost in (
        ("modes", 3.0, 9.0),
        ("own", 3.0, 9.0),
        ("turns", 3.0, 9.0),
        ("albedo", 5.0, 1.0),
    ):
        values = getattr(none, part).copy()
        values[0, 1] = size * np.eye(len(values[0, 1]))[0] if part == "own" else size
        more = objective.cost(replace(none, **{part: values})) - objective.cost(none)
        assert more == pytest.approx(cost, abs=1e-6)


def test_uneven_albedo_costs_less_than_its_square(even: tuple[Scene, State]) -> None:
    """Four times ln(1 + χ²/4): 4 ln 2 at two standard deviations."""
    scene, state = even
    objective = make_objective(scene, state, 0.05)
    off = state.albedo.copy()
    off[:, 0] += 2 * objective.albedo_sigma

    more = objective.cost(replace(state, albedo=off)) - objective.cost(state)

    assert more == pytest.approx(4 * np.log(2) * scene.tint_weights.sum())


@pytest.mark.parametrize(
    ("scale", "off", "sigma"),
    [
        (0.02, 0.0, 0.01),
        (0.32, 0.0, 0.01 * np.sqrt(16)),
        (0.02, 0.1, np.hypot(0.01, 0.148)),
    ],
)
def test_albedo_is_as_even_as_the_state_has_it_but_for_a_hundredth(
    even: tuple[Scene, State], scale: float, off: float, sigma: float
) -> None:
    """Coarse scales take it for less even; of normal deviations the median is 1 ÷ 1.48."""
    scene, state = even
    uneven = state.albedo.copy()
    uneven[:, 0] += off

    found = make_objective(scene, replace(state, albedo=uneven), scale)

    assert found.albedo_sigma == pytest.approx(sigma, rel=1e-6)
    # narrow deviations are no likelier than wide ones for nothing
    wide = replace(found, albedo_sigma=np.e * found.albedo_sigma)
    more = wide.cost(state) - found.cost(state)
    assert more == pytest.approx(2 * scene.tint_weights.sum(), rel=1e-6)


def test_light_has_its_variance_an_error_of_its_scale_and_a_floor(
    posed: tuple[Scene, State],
) -> None:
    """A highlight does not lift the floor."""
    scene, state = posed
    light = np.ones_like(scene.light)
    light[0], light[1] = 0.0, 1000.0
    variance = np.full_like(light, 1e-6)

    found = make_objective(replace(scene, light=light, variance=variance), state, 0.03)

    assert found.precision[0] == pytest.approx(1 / (1e-6 + 0.002**2))
    assert found.precision[2] == pytest.approx(1 / (1e-6 + 0.03**2 + 0.002**2))


def test_bends_cost_less_than_their_square(posed: tuple[Scene, State]) -> None:
    """0.36 ln 2 where slopes change by a tenth per pixel, as at a peak; half of that around it."""
    scene, state = posed
    h = np.ones_like(state.h)
    peak = int(np.bincount(scene.grid.bent.ravel()).argmax())
    h[peak] += 0.1 / scene.grid.focal_px

    soft, stiff = (make_objective(scene, state, 0.05, stiffness) for stiffness in (0.0, 1.0))
    cost = stiff.cost(replace(state, h=h)) - soft.cost(replace(state, h=h))

    assert cost == pytest.approx(0.36 * (2 * np.log(2) + 4 * np.log(1.25)), rel=1e-4)


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


def test_light_tells_which_lamps_light_a_pixel_that_faces_them(posed: tuple[Scene, State]) -> None:
    """Light of a state in which every third pixel is in the shadow of one of two lamps."""
    scene, state = posed
    faced = facing(scene, state)
    bright = (faced > 0.5).all(axis=1)
    lit = faced > 0
    lit[::3, 0] = lit[1::3, 2] = False
    scene = replace(scene, light=predicted(scene, replace(state, lit=lit)))

    found = make_objective(scene, replace(state, lit=faced > 0), 0.01).lit(state)

    assert bright.sum() > 100
    np.testing.assert_array_equal(found[bright], lit[bright])
    assert not found[faced <= 0].any()


def test_a_lamp_that_makes_no_difference_is_not_in_shadow(posed: tuple[Scene, State]) -> None:
    """All light is lost in noise."""
    scene, state = posed
    scene = replace(scene, light=0 * scene.light, variance=np.full_like(scene.light, 1e6))

    found = make_objective(scene, state, 0.01).lit(state)

    np.testing.assert_array_equal(found, facing(scene, state) > 0)
