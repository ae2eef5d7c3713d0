from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.photometric_stereo.scene import (
    Scene,
    State,
    directions,
    lamp_light,
    predicted,
    response_matrices,
    responses,
)
from pipeline.vectors import angles_deg


@pytest.fixture
def painted(ball: Callable[..., Any], scene_of: Callable[..., Scene]) -> tuple[Any, Scene]:
    one = ball(materials=4)
    return one, scene_of(one)


def test_the_true_surface_predicts_the_light(
    ball: Callable[..., Any], scene_of: Callable[..., Scene], true_state: Callable[..., Any]
) -> None:
    """As nearly as the usual matrices of the lamps' colours do."""
    one = ball()
    scene = scene_of(one)

    found = predicted(scene, true_state(one, scene))

    lit = one.lit[one.inside]
    ratio = found[lit].sum(axis=1) / scene.light[lit].sum(axis=1)
    assert np.abs(np.median(ratio) - 1) < 0.06
    assert np.ptp(np.quantile(ratio, [0.05, 0.95])) < 0.12


def test_a_lamp_that_is_off_gives_no_light(
    painted: tuple[Any, Scene], true_state: Callable[..., Any]
) -> None:
    one, scene = painted
    state = true_state(one, scene)
    alone = [
        predicted(scene, replace(state, lit=state.lit & (np.arange(3) == j))) for j in range(3)
    ]

    np.testing.assert_allclose(np.sum(alone, axis=0), predicted(scene, state), rtol=1e-12)
    assert (alone[0][~state.lit[:, 0]] == 0).all()


def test_a_turn_of_one_is_five_degrees(
    painted: tuple[Any, Scene], true_state: Callable[..., Any]
) -> None:
    one, scene = painted
    state = true_state(one, scene)
    turns = np.array([[0.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])

    found = directions(scene, replace(state, turns=turns))

    np.testing.assert_allclose(directions(scene, state), one.directions)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    off = angles_deg((found * one.directions).sum(axis=1))
    assert off == pytest.approx([0, 4.99, 4.99], abs=0.01)


def test_deviations_belong_to_their_material_and_their_lamp(
    painted: tuple[Any, Scene], true_state: Callable[..., Any]
) -> None:
    one, scene = painted
    state = true_state(one, scene)
    own = state.own.copy()
    own[2, 1] = [1.0, -2.0, 0.5]

    matrices, deviations = response_matrices(scene, replace(state, own=own))

    of_it = (scene.shares[0] == 2) * scene.shares[1]
    expected = of_it.sum(axis=1)[:, None] * (scene.priors[1].material @ own[2, 1])
    np.testing.assert_allclose(deviations[:, 1], expected, atol=1e-15)
    assert (deviations[:, [0, 2]] == 0).all()
    np.testing.assert_array_equal(matrices, [prior.mean for prior in scene.priors])


def test_responses_are_the_matrices_and_what_materials_add(
    painted: tuple[Any, Scene], true_state: Callable[..., Any]
) -> None:
    one, scene = painted
    state = true_state(one, scene)
    modes = state.modes.copy()
    modes[0, 1] = 0.7
    state = replace(state, modes=modes, own=np.full_like(state.own, 0.3))

    matrices, deviations = response_matrices(scene, state)
    found = responses(scene, state)

    np.testing.assert_allclose(
        matrices[0], scene.priors[0].mean + 0.7 * scene.priors[0].modes[1], rtol=1e-12
    )
    pixel = 100
    for j in range(3):
        expected = matrices[j] @ scene.flash[pixel] + scene.total[pixel] * deviations[pixel, j]
        np.testing.assert_allclose(found[pixel, j], expected, rtol=1e-12)


def test_tints_are_beside_the_mean_of_their_segment(painted: tuple[Any, Scene]) -> None:
    _, scene = painted

    own = scene.segments[scene.tinted]
    assert (own >= 0).all()
    for number in range(scene.segment_count):
        np.testing.assert_allclose(scene.tints[own == number, 1:].mean(axis=0), 0, atol=1e-12)
    assert (scene.tints[:, 0] == 1).all()


def test_the_albedo_of_dim_pixels_counts_less(painted: tuple[Any, Scene]) -> None:
    """By their light of the flash, up to that which three tenths of all pixels do not have."""
    _, scene = painted

    bright = np.quantile(scene.total, 0.3)
    expected = np.clip(scene.total[scene.tinted] / bright, 0, 1)
    np.testing.assert_allclose(scene.tint_weights, expected)


def test_the_light_alone_tells_how_bright_each_lamp_is(
    ball: Callable[..., Any],
    scene_of: Callable[..., Scene],
    true_state: Callable[..., State],
) -> None:
    """By lamps as fitted: of light made of them, with one in shadow."""
    one = ball(24)
    scene = scene_of(one)
    state = true_state(one, scene)
    shaded = replace(state, lit=state.lit & [True, False, True])
    made = replace(scene, light=predicted(scene, shaded))

    found = lamp_light(made, state, np.ones_like(made.light))

    brightness = (scene.grid.w(state.h) @ scene.directions.T) * shaded.lit
    np.testing.assert_allclose(found, brightness, atol=1e-5)
