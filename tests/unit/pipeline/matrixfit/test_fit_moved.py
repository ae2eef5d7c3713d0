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
from pipeline.matrixfit.evidence import Evidence, gather_evidence
from pipeline.matrixfit.fit import Fit, fit_matrices, fit_pools, follow_outwards
from pipeline.matrixfit.known import nothing_known
from pipeline.matrixfit.search import Problem
from pipeline.pair.reduced import reduce_pair

Off = Callable[[Floats64, Floats64], float]


@pytest.mark.parametrize("which", [[0, 2], [0, 1, 2]])
def test_pools_beside_edges_move_lamps(
    shadowed: Callable[[Floats64], Any],
    model: Model,
    warm_to_cool: Floats64,
    off: Off,
    which: list[int],
) -> None:
    """All lamps hold some of the next one's light, and edges tell nothing."""
    true = model.lamp_matrix(warm_to_cool[which])
    true /= np.linalg.norm(true, axis=(1, 2), keepdims=True)
    reduced, nothing = reduce_pair(shadowed(warm_to_cool[which])), nothing_known(model.flash_white)
    found = gather_evidence(reduced)
    anywhere = np.random.default_rng(1).uniform(0.0, 0.6, found.differences.u.shape)
    found = replace(
        found, differences=replace(found.differences, u=anywhere), pools=found.differences
    )
    usual = Fit(0.9 * true + 0.1 * np.roll(true, 1, axis=0), 7.0)

    moved = fit_pools(reduced, found, model, nothing, usual)

    assert off(usual.matrices, true) > 0.04
    assert off(moved.matrices, true) < 0.008
    assert moved.cost == 7.0  # lamps are counted without pools
    assert fit_pools(reduced, found.surest, model, nothing, usual) is usual


def test_beside_edges_lamps_are_found_without_pools(
    shadowed: Callable[[Floats64], Any],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where they leave much, and are found in other ways."""
    reduced, nothing = reduce_pair(shadowed(warm_to_cool)), nothing_known(model.flash_white)
    found = gather_evidence(reduced)
    wrong = replace(found.differences, u=found.differences.u[::-1])
    asked: list[int] = []

    def noting(_: Problem, evidence: Evidence, __: Floats64) -> list[Floats64]:
        asked.append(len(evidence.pools))
        return []

    monkeypatch.setattr(fit, "unexplained", lambda *_: 9.0)
    monkeypatch.setattr(fit, "_otherwise", noting)
    one, other = (
        fit_matrices(reduced, replace(found, pools=pools), model, 3, nothing)
        for pools in (wrong, found.surest.pools)
    )

    np.testing.assert_array_equal(one.matrices, other.matrices)
    assert one.cost == other.cost
    assert asked == [0, 0]


@pytest.mark.parametrize("step", [fit_pools, follow_outwards])
@pytest.mark.parametrize("which", [[0, 2], [0, 1, 2]])
def test_coves_are_left_out_of_the_pools_of_three_lamps(
    shadowed: Callable[[Floats64], Any],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    step: Callable[..., Fit],
    which: list[int],
) -> None:
    """Every second pool has the light of all lamps."""
    true = model.lamp_matrix(warm_to_cool[which])
    reduced, nothing = reduce_pair(shadowed(warm_to_cool[which])), nothing_known(model.flash_white)
    found = gather_evidence(reduced)
    corners = found.differences.corners(true)
    some = np.arange(len(found.differences)) % 2 > 0
    u = np.where(some[:, None], corners.mean(axis=0), corners[0])
    asked: list[int] = []

    def noting(problem: Problem, _: object) -> tuple[Floats64, float]:
        asked.append(len(problem.terms[2].data))
        return true, 0.0

    monkeypatch.setattr(fit, "follow", noting)
    monkeypatch.setattr(fit, "search", noting)
    monkeypatch.setattr(fit, "unexplained", lambda *_: 9.0)
    pools = replace(found.differences, u=u)
    step(reduced, replace(found, pools=pools), model, nothing, Fit(true, 1.0))

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
    reduced = reduce_pair(shadowed(warm_to_cool[[0, 2]]))
    found = gather_evidence(reduced)
    found = replace(found, pools=found.differences)

    moved = fit_pools(reduced, found, model, known, Fit(lamps["usual"], 1.0))

    np.testing.assert_array_equal(moved.matrices, lamps[taken])


def test_pools_leave_one_lamp_and_forbidden_ones_as_they_are(
    shadowed: Callable[[Floats64], Any], model: Model, warm_to_cool: Floats64
) -> None:
    reduced, nothing = reduce_pair(shadowed(warm_to_cool[:1])), nothing_known(model.flash_white)
    found = gather_evidence(reduced)
    found = replace(found, pools=found.differences)
    one = Fit(model.lamp_matrix(warm_to_cool[:1]), 1.0)
    none = Fit(model.lamp_matrix(warm_to_cool[:2]), np.inf)

    assert fit_pools(reduced, found, model, nothing, one) is one
    assert fit_pools(reduced, found, model, nothing, none) is none


def test_two_lamps_that_stand_within_the_cloud_are_followed_outwards(
    shadowed: Callable[[Floats64], Any], model: Model, warm_to_cool: Floats64, off: Off
) -> None:
    """Both lamps hold some of the other's light, as where nearly all light is mixed."""
    true = model.lamp_matrix(warm_to_cool[[0, 2]])
    true /= np.linalg.norm(true, axis=(1, 2), keepdims=True)
    within = 0.9 * true + 0.1 * true[::-1]
    reduced, nothing = reduce_pair(shadowed(warm_to_cool[[0, 2]])), nothing_known(model.flash_white)
    evidence = gather_evidence(reduced)

    found = follow_outwards(reduced, evidence, model, nothing, Fit(within, 7.0))

    assert off(within, true) > 0.05
    assert off(found.matrices, true) < 0.006
    assert found.cost == 7.0  # costs of numbers of lamps are of one share of pure pixels


@pytest.mark.parametrize(
    ("of_mean", "of_worst", "of_mirrors", "forbidden", "rendered", "taken"),
    [
        (0.92, 0.97, 0.35, False, False, True),
        (0.94, 0.5, 0.0, False, False, False),
        (0.5, 0.99, 0.0, False, False, False),
        (0.5, 0.5, 0.36, False, False, False),
        (0.5, 0.5, 0.0, True, False, False),
        (0.5, 0.5, 0.0, False, True, False),
    ],
)
def test_two_lamps_give_way_to_those_that_leave_clearly_less(
    shadowed: Callable[[Floats64], Any],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    of_mean: float,
    of_worst: float,
    of_mirrors: float,
    forbidden: bool,
    rendered: bool,
    taken: bool,
) -> None:
    """In all and where most is left, not by a mirror or what is forbidden, not in a rendering."""
    usual, other = (model.lamp_matrix(warm_to_cool[lamps]) for lamps in ([0, 1], [0, 2]))

    def left(worse: float, better: float) -> Callable[[Any, Floats64], float]:
        return lambda _, matrices: better if np.array_equal(matrices, other) else worse

    monkeypatch.setattr(fit, "follow", lambda *_: (other, 0.0))
    monkeypatch.setattr(fit, "mean_left_over", left(0.004, 0.004 * of_mean))
    monkeypatch.setattr(fit, "left_over", left(0.02, 0.02 * of_worst))
    monkeypatch.setattr(fit, "most_mirrored", lambda *_: of_mirrors)
    known = nothing_known(model.flash_white)
    if forbidden:
        known = replace(known, forbidden=warm_to_cool[2:])
    reduced = reduce_pair(replace(shadowed(warm_to_cool[[0, 2]]), rendered=rendered))
    evidence = gather_evidence(reduced)

    found = follow_outwards(reduced, evidence, model, known, Fit(usual, 1.0))

    np.testing.assert_array_equal(found.matrices, other if taken else usual)


@pytest.mark.parametrize(
    ("usual_leaves", "other_leaves", "taken"),
    [(1.0, 0.94, True), (1.0, 0.96, False), (0.6, 0.3, False)],
)
def test_three_lamps_give_way_to_those_that_leave_clearly_less(
    shadowed: Callable[[Floats64], Any],
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
    known, reduced = nothing_known(model.flash_white), reduce_pair(shadowed(warm_to_cool))
    evidence = gather_evidence(reduced)

    found = follow_outwards(reduced, evidence, model, known, Fit(usual, 1.0))

    np.testing.assert_array_equal(found.matrices, other if taken else usual)
