"""Lamps that were fitted, moved by pools of light and followed outwards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.light.model import Model
from pipeline.matrixfit import fit
from pipeline.matrixfit.fit import Fit, FitInput, fit_matrices, fit_pools, follow_outwards
from pipeline.matrixfit.known import nothing_known
from pipeline.matrixfit.search import Problem

Off = Callable[[Floats64, Floats64], float]


def edges_for_pools(given: FitInput) -> FitInput:
    """Take the edges of shadows for pools of light, too."""
    evidence = replace(given.evidence, pools=given.evidence.differences)
    return replace(given, evidence=evidence)


@pytest.mark.parametrize("which", [[0, 2], [0, 1, 2]])
def test_pools_beside_edges_move_lamps(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
    off: Off,
    which: list[int],
) -> None:
    """All lamps hold some of the next one's light, and edges tell nothing."""
    true = model.lamp_matrix(warm_to_cool[which])
    true /= np.linalg.norm(true, axis=(1, 2), keepdims=True)
    given = fit_input(shadowed(warm_to_cool[which]))
    edges = given.evidence.differences
    anywhere = replace(edges, u=np.random.default_rng(1).uniform(0.0, 0.6, edges.u.shape))
    given = replace(given, evidence=replace(given.evidence, differences=anywhere, pools=edges))
    usual = Fit(0.9 * true + 0.1 * np.roll(true, 1, axis=0), 7.0)

    moved = fit_pools(given, usual)

    assert off(usual.matrices, true) > 0.04
    assert off(moved.matrices, true) < 0.008
    assert moved.cost == 7.0  # lamps are counted without pools
    assert fit_pools(given.surest, usual) is usual


def test_beside_edges_lamps_are_found_without_pools(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where they leave much, and are found in other ways."""
    given = fit_input(shadowed(warm_to_cool))
    edges = given.evidence.differences
    wrong = replace(edges, u=edges.u[::-1])
    asked: list[int] = []

    def noting(given: FitInput) -> list[Floats64]:
        asked.append(len(given.evidence.pools))
        return []

    monkeypatch.setattr(fit, "unexplained", lambda *_: 9.0)
    monkeypatch.setattr(fit, "_otherwise", noting)
    one, other = (
        fit_matrices(replace(given, evidence=replace(given.evidence, pools=pools)), 3)
        for pools in (wrong, given.surest.evidence.pools)
    )

    np.testing.assert_array_equal(one.matrices, other.matrices)
    assert one.cost == other.cost
    assert asked == [0, 0]


@pytest.mark.parametrize("step", [fit_pools, follow_outwards])
@pytest.mark.parametrize("which", [[0, 2], [0, 1, 2]])
def test_coves_are_left_out_of_the_pools_of_three_lamps(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    step: Callable[..., Fit],
    which: list[int],
) -> None:
    """Every second pool has the light of all lamps."""
    true = model.lamp_matrix(warm_to_cool[which])
    given = fit_input(shadowed(warm_to_cool[which]))
    edges = given.evidence.differences
    corners = edges.corners(true)
    some = np.arange(len(edges)) % 2 > 0
    u = np.where(some[:, None], corners.mean(axis=0), corners[0])
    asked: list[int] = []

    def noting(problem: Problem, _: object) -> tuple[Floats64, float]:
        asked.append(len(problem.terms[2].data))
        return true, 0.0

    monkeypatch.setattr(fit, "follow", noting)
    monkeypatch.setattr(fit, "search", noting)
    monkeypatch.setattr(fit, "unexplained", lambda *_: 9.0)
    evidence = replace(given.evidence, pools=replace(edges, u=u))
    step(replace(given, evidence=evidence), Fit(true, 1.0))

    assert asked
    assert set(asked) == {len(some) if len(which) == 2 else len(some) - some.sum()}


@pytest.mark.parametrize(
    ("leave", "likelier", "of_mirrors", "forbidden", "taken"),
    [
        (0.61, 2.9, 0.0, None, "followed"),
        (0.61, 3.1, 0.35, None, "other"),
        (0.59, 3.1, 0.35, None, "followed"),
        (0.61, 3.1, 0.36, None, "usual"),
        (0.61, 2.9, 0.0, 1, "usual"),
        (0.61, 3.1, 0.0, 1, "other"),
        (0.61, 3.1, 0.0, 2, "usual"),
    ],
)
def test_by_pools_lamps_are_followed_unless_others_are_clearly_likelier(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    leave: float,
    likelier: float,
    of_mirrors: float,
    forbidden: int | None,
    taken: str,
) -> None:
    """And they leave much; neither by a mirror nor to what is forbidden."""
    lamps = {
        "usual": model.lamp_matrix(warm_to_cool[[0, 0]]),
        "followed": model.lamp_matrix(warm_to_cool[[0, 1]]),
        "other": model.lamp_matrix(warm_to_cool[[0, 2]]),
    }
    monkeypatch.setattr(fit, "follow", lambda *_: (lamps["followed"], 100.0))
    monkeypatch.setattr(fit, "search", lambda *_: (lamps["other"], 100.0 - likelier))
    monkeypatch.setattr(fit, "most_mirrored", lambda *_: of_mirrors)
    monkeypatch.setattr(fit, "unexplained", lambda *_: leave)
    known = nothing_known(model.flash_white)
    if forbidden is not None:
        whites = model.lamp_matrix(warm_to_cool[[forbidden]]) @ model.flash_white
        known = replace(known, forbidden=whites / np.linalg.norm(whites))
    given = edges_for_pools(fit_input(shadowed(warm_to_cool[[0, 2]]), known))

    moved = fit_pools(given, Fit(lamps["usual"], 1.0))

    np.testing.assert_array_equal(moved.matrices, lamps[taken])


def test_pools_leave_one_lamp_and_forbidden_ones_as_they_are(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
) -> None:
    given = edges_for_pools(fit_input(shadowed(warm_to_cool[:1])))
    one = Fit(model.lamp_matrix(warm_to_cool[:1]), 1.0)
    none = Fit(model.lamp_matrix(warm_to_cool[:2]), np.inf)

    assert fit_pools(given, one) is one
    assert fit_pools(given, none) is none


def test_two_lamps_that_stand_within_the_cloud_are_followed_outwards(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
    off: Off,
) -> None:
    """Both lamps hold some of the other's light, as where nearly all light is mixed."""
    true = model.lamp_matrix(warm_to_cool[[0, 2]])
    true /= np.linalg.norm(true, axis=(1, 2), keepdims=True)
    within = 0.9 * true + 0.1 * true[::-1]

    found = follow_outwards(fit_input(shadowed(warm_to_cool[[0, 2]])), Fit(within, 7.0))

    assert off(within, true) > 0.05
    assert off(found.matrices, true) < 0.006
    assert found.cost == 7.0  # costs of numbers of lamps are of one share of pure pixels


@pytest.mark.parametrize(
    ("of_mean", "worst", "of_worst", "of_mirrors", "forbidden", "rendered", "taken"),
    [
        (0.92, 0.02, 0.97, 0.35, False, False, True),
        (0.94, 0.02, 0.5, 0.0, False, False, False),
        (0.5, 0.02, 0.99, 0.0, False, False, False),
        (0.5, 0.02, 0.5, 0.36, False, False, False),
        (0.5, 0.02, 0.5, 0.0, True, False, False),
        (0.5, 0.02, 0.5, 0.0, False, True, False),
        (0.92, 0.0, 1.0, 0.0, False, False, True),
        (0.94, 0.0, 1.0, 0.0, False, False, False),
    ],
)
def test_two_lamps_give_way_to_those_that_leave_clearly_less(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    of_mean: float,
    worst: float,
    of_worst: float,
    of_mirrors: float,
    forbidden: bool,
    rendered: bool,
    taken: bool,
) -> None:
    """In all and where most is left, not by a mirror or what is forbidden, not in a rendering.

    Noise may hide all that is left at the worst places: that is no reason to stay.
    """
    usual, other = (model.lamp_matrix(warm_to_cool[lamps]) for lamps in ([0, 1], [0, 2]))

    def left(worse: float, better: float) -> Callable[[Any, Floats64], float]:
        return lambda _, matrices: better if np.array_equal(matrices, other) else worse

    monkeypatch.setattr(fit, "follow", lambda *_: (other, 0.0))
    monkeypatch.setattr(fit, "mean_left_over", left(0.004, 0.004 * of_mean))
    monkeypatch.setattr(fit, "left_over", left(worst, worst * of_worst))
    monkeypatch.setattr(fit, "most_mirrored", lambda *_: of_mirrors)
    known = nothing_known(model.flash_white)
    if forbidden:
        known = replace(known, forbidden=warm_to_cool[2:])
    pair = replace(shadowed(warm_to_cool[[0, 2]]), rendered=rendered)

    found = follow_outwards(fit_input(pair, known), Fit(usual, 1.0))

    np.testing.assert_array_equal(found.matrices, other if taken else usual)


@pytest.mark.parametrize(
    ("usual_leaves", "other_leaves", "taken"),
    [(1.0, 0.94, True), (1.0, 0.96, False), (0.6, 0.3, False)],
)
def test_three_lamps_give_way_to_those_that_leave_clearly_less(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    usual_leaves: float,
    other_leaves: float,
    taken: bool,
) -> None:
    """If they leave much at all."""
    usual, other = model.lamp_matrix(warm_to_cool), model.lamp_matrix(np.roll(warm_to_cool, 1))

    def left(_reduced: Any, _evidence: Any, matrices: Floats64) -> float:
        return other_leaves if np.array_equal(matrices, other) else usual_leaves

    monkeypatch.setattr(fit, "follow", lambda *_: (other, 0.0))
    monkeypatch.setattr(fit, "unexplained", left)

    found = follow_outwards(fit_input(shadowed(warm_to_cool)), Fit(usual, 1.0))

    np.testing.assert_array_equal(found.matrices, other if taken else usual)
