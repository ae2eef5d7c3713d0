from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.light.model import Model
from pipeline.matrixfit import search as search_module
from pipeline.matrixfit.evidence import evidence_of_surfaces, gather_evidence
from pipeline.matrixfit.fit import fit_pin
from pipeline.matrixfit.known import nothing_known
from pipeline.matrixfit.minimum import minimum
from pipeline.matrixfit.objective import make_terms
from pipeline.matrixfit.search import LEVELS, Problem, follow, search
from pipeline.pair.reduced import reduce_pair

Off = Callable[[Floats64, Floats64], float]


@pytest.fixture
def problem(
    shadowed: Callable[[Floats64], Any], model: Model, warm_to_cool: Floats64
) -> Callable[[int], Problem]:
    """Pose the problem of finding the lamps behind shadows."""

    def of_lamps(lamps: int) -> Problem:
        evidence = gather_evidence(reduce_pair(shadowed(warm_to_cool[:lamps])))
        pure_share = 0.15 if lamps == 2 else 0.02
        terms = make_terms(evidence, lamps, False, pure_share, model.flash_white)
        return Problem(lamps, terms, model.prior, LEVELS, nothing_known(model.flash_white))

    return of_lamps


@pytest.mark.parametrize("lamps", [1, 2, 3])
def test_the_likeliest_of_the_candidates_are_found(
    problem: Callable[[int], Problem], model: Model, warm_to_cool: Floats64, lamps: int, off: Off
) -> None:
    """Wrong candidates stand before the true ones, which are a little off."""
    true = model.lamp_matrix(warm_to_cool[:lamps])
    wrong = model.lamp_matrix(np.random.default_rng(5).dirichlet(5 * np.ones(3), 8))
    near = model.lamp_matrix(warm_to_cool[:lamps] + np.array([0.01, 0.0, -0.01]))

    found, _ = search(problem(lamps), np.concatenate([wrong, near]))

    assert found.shape == (lamps, 3, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=(1, 2)), 1)
    assert off(near, true) > 0.006
    assert off(found, true) < 0.006


def test_rounds_begin_with_what_is_known_and_searches_get_more_exact(
    problem: Callable[[int], Problem],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three rounds each: of a start, and at three levels."""
    asked = []

    def recorded(
        function: Any, start: Floats64, steps: int, precision: float, first: float, inverse: Any
    ) -> Any:
        asked.append((precision, inverse is not None))
        return minimum(function, start, steps, precision, first, inverse)

    monkeypatch.setattr(search_module, "minimum", recorded)
    monkeypatch.setattr(search_module, "_STARTS", 1)

    search(problem(2), model.lamp_matrix(warm_to_cool[:2]))

    assert [precision for precision, _ in asked[::3]] == [1e-4, 1e-5, 1e-5, 1e-6]
    assert [known for _, known in asked] == 4 * [False, True, True]


@pytest.mark.parametrize("lamps", [1, 2, 3])
def test_fewer_candidates_than_lamps_are_taken_more_than_once(
    problem: Callable[[int], Problem], model: Model, warm_to_cool: Floats64, lamps: int, off: Off
) -> None:
    found, _ = search(problem(lamps), model.lamp_matrix(warm_to_cool[:1]))

    assert found.shape == (lamps, 3, 3)
    assert off(found, model.lamp_matrix(warm_to_cool[:1])) < 0.006


def test_of_starts_the_one_is_followed_that_leads_to_the_likeliest(
    problem: Callable[[int], Problem], model: Model, warm_to_cool: Floats64, off: Off
) -> None:
    true = model.lamp_matrix(warm_to_cool[:2])
    alike = np.repeat(model.lamp_matrix(warm_to_cool.mean(axis=0))[None], 2, axis=0)
    posed = problem(2)

    found = [follow(posed, starts) for starts in ([alike, true], [true, alike])]
    far, far_cost = follow(posed, [alike])

    np.testing.assert_array_equal(found[0][0], found[1][0])
    assert off(found[0][0], true) < 0.006
    assert off(far, true) > 0.02
    assert found[0][1] == found[1][1] < far_cost - 10


def test_the_scale_of_a_start_does_not_matter(
    problem: Callable[[int], Problem], model: Model, warm_to_cool: Floats64
) -> None:
    start = model.lamp_matrix(warm_to_cool[:2] + 0.02)
    posed = problem(2)

    (once, _), (tenfold, _) = follow(posed, [start]), follow(posed, [10 * start])

    np.testing.assert_allclose(once, tenfold, atol=1e-4)


def test_what_explains_a_sample_best_is_tried_first(
    problem: Callable[[int], Problem],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    off: Off,
) -> None:
    """Each pair of candidates is an optimum for itself, as nothing is moved."""
    monkeypatch.setattr(search_module, "_STARTS", 1)
    monkeypatch.setattr(search_module, "_STEPS", 0)
    true = model.lamp_matrix(warm_to_cool[:2])
    wrong = model.lamp_matrix(np.random.default_rng(5).dirichlet(5 * np.ones(3), 8))

    found, _ = search(problem(2), np.concatenate([wrong, true]))

    assert off(found, true) < 0.005


def test_pinned_lamps_come_first_and_are_held(
    problem: Callable[[int], Problem],
    model: Model,
    surfaces: Floats64,
    warm_to_cool: Floats64,
    off: Off,
) -> None:
    """Also one that the evidence does not show."""
    pinned = model.lamp_matrix(np.array([0.6, 0.7, 0.3]))
    pin = fit_pin(evidence_of_surfaces(surfaces, surfaces @ pinned.T), model, True)
    true = model.lamp_matrix(warm_to_cool[:2])
    known = replace(nothing_known(model.flash_white), pinned=(pin,))

    found, _ = search(replace(problem(2), lamps=3, known=known, terms=problem(3).terms), true)

    assert off(found[:1], pinned[None]) < 0.01
    assert off(found[1:], true) < 0.02


def test_no_free_lamp_ends_at_a_forbidden_one(
    problem: Callable[[int], Problem], model: Model, warm_to_cool: Floats64, off: Off
) -> None:
    true = model.lamp_matrix(warm_to_cool[:2])
    others = model.lamp_matrix(np.array([[0.6, 0.7, 0.4], [0.5, 0.8, 0.2]]))
    posed = problem(2)
    assert off(search(posed, np.concatenate([true, others]))[0], true) < 0.006
    white = true[0] @ model.flash_white
    known = replace(posed.known, forbidden=white[None] / np.linalg.norm(white))

    found, _ = search(replace(posed, known=known), np.concatenate([true, others]))

    assert not known.forbids(found).any()
