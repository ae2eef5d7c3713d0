"""Lamps that the user has pinned or forbidden."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import OptionError
from pipeline.lamps import lamps
from pipeline.lamps.lamps import estimate_lamps
from pipeline.light.model import Model
from pipeline.matrixfit.evidence import evidence_of_surfaces
from pipeline.matrixfit.fit import Fit, FitInput, fit_pin
from pipeline.matrixfit.known import Known, nothing_known
from pipeline.pair.reduced import reduce_pair
from pipeline.run_warnings import Code
from tests.angles import angles

Exact = Callable[..., tuple[Any, Floats64]]
Shadowed = Callable[[Floats64], Any]


@pytest.fixture
def pinned(model: Model, surfaces: Floats64) -> Callable[[Floats64], Known]:
    """Pin lamps by their coefficients."""

    def of_lamps(coefficients: Floats64) -> Known:
        matrices = model.lamp_matrix(coefficients)
        pins = [
            fit_pin(evidence_of_surfaces(surfaces, surfaces @ matrix.T), model, False)
            for matrix in matrices
        ]
        return replace(nothing_known(model.flash_white), pinned=tuple(pins))

    return of_lamps


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_a_pinned_lamp_that_is_not_there_is_doubted_among_right_ones(
    shadowed: Shadowed,
    model: Model,
    warm_to_cool: Floats64,
    pinned: Callable[[Floats64], Known],
    order: tuple[int, ...],
) -> None:
    """Of three pinned lamps two shine."""
    reduced = reduce_pair(shadowed(warm_to_cool[:2]))

    found = estimate_lamps(reduced, model, "auto", "best", pinned(warm_to_cool[list(order)]))
    right = estimate_lamps(reduced, model, "auto", "best", pinned(warm_to_cool[:2]))

    (warning,) = found.contradictions
    assert (warning.code, warning.figures) == (
        Code.PIN_CONTRADICTED,
        {"pin": order.index(2) + 1},
    )
    assert right.contradictions == ()


@pytest.mark.parametrize(
    ("which", "expected"), [((2, 0), [1, 0]), ((0, 2), [0, 1]), ((2,), [-1, 0])]
)
def test_it_is_told_which_lamps_were_pinned(
    shadowed: Shadowed,
    model: Model,
    warm_to_cool: Floats64,
    pinned: Callable[[Floats64], Known],
    which: tuple[int, ...],
    expected: list[int],
) -> None:
    true = warm_to_cool[[0, 2]]
    known = pinned(warm_to_cool[list(which)])

    found = estimate_lamps(reduce_pair(shadowed(true)), model, "auto", "best", known)

    assert found.pinned.tolist() == expected
    whites = model.lamp_matrix(true) @ model.flash_white
    assert angles(found.coefficients, whites).max() < 0.3
    assert found.contradictions == ()


def test_as_many_lamps_are_found_as_are_pinned(
    shadowed: Shadowed, model: Model, warm_to_cool: Floats64, pinned: Callable[[Floats64], Known]
) -> None:
    reduced = reduce_pair(shadowed(warm_to_cool[:1]))

    found = estimate_lamps(reduced, model, "auto", "best", pinned(warm_to_cool[[2, 0]]))

    assert found.pinned.tolist() == [1, 0]
    whites = model.lamp_matrix(warm_to_cool[[0, 2]]) @ model.flash_white
    assert angles(found.coefficients, whites).max() < 1


@pytest.mark.parametrize(("pins", "least"), [(None, 1), (0, 1), (1, 1), (2, 2), (3, 3)])
def test_counting_begins_with_what_is_known_and_never_below_one(
    exact: Exact,
    model: Model,
    warm_to_cool: Floats64,
    pinned: Callable[[Floats64], Known],
    monkeypatch: pytest.MonkeyPatch,
    pins: int | None,
    least: int,
) -> None:
    """Where more lamps are less likely, it ends there, too."""
    asked = set()

    def fit(_: FitInput, lamps: int, *__: Fit) -> Fit:
        asked.add(lamps)
        return Fit(model.lamp_matrix(warm_to_cool[:lamps]), 900.0 * lamps)

    monkeypatch.setattr(lamps, "fit_matrices", fit)
    known = None if pins is None else pinned(warm_to_cool[:pins])
    reduced = reduce_pair(exact(warm_to_cool[:least])[0])

    found = estimate_lamps(reduced, model, "auto", "best", known)

    assert len(found) == min(asked) == least
    assert found.pinned.tolist() == [*range(pins or 0), *[-1] * (least - (pins or 0))]


def test_pins_that_the_photograph_contradicts_are_doubted(
    shadowed: Shadowed, model: Model, warm_to_cool: Floats64, pinned: Callable[[Floats64], Known]
) -> None:
    reduced = reduce_pair(shadowed(warm_to_cool[[0, 2]]))

    found = estimate_lamps(reduced, model, 2, "best", pinned(warm_to_cool[[1]]))

    assert 0 in found.pinned
    (warning,) = found.contradictions
    assert (warning.code, warning.figures) == (Code.PIN_CONTRADICTED, {"pin": 1})


@pytest.mark.parametrize(
    ("coefficients", "pins", "in_srgb", "told"),
    [
        ((0.36, -1.0, -0.09), 1, False, False),
        ((-0.36, 1.0, 0.09), 1, False, False),
        ((-0.36, 1.0, 0.09), 1, True, True),
        ((-0.36, 1.0, 0.09), 0, False, True),
        ((0.02, 1.0, 0.3), 1, False, True),
    ],
)
def test_what_no_light_can_be_is_no_rival_of_lamps_beside_a_pinned_one(
    shadowed: Shadowed,
    model: Model,
    warm_to_cool: Floats64,
    pinned: Callable[[Floats64], Known],
    monkeypatch: pytest.MonkeyPatch,
    coefficients: tuple[float, float, float],
    pins: int,
    in_srgb: bool,
    told: bool,
) -> None:
    model = replace(model, camera=replace(model.camera, in_srgb=in_srgb))
    true = model.lamp_matrix(warm_to_cool[[0, 2]])
    rival = np.stack([true[0], model.lamp_matrix(np.array(coefficients))])
    for name in ("first_fit", "fit_matrices"):
        monkeypatch.setattr(lamps, name, lambda *_: Fit(true, 0.0, (rival,)))
    monkeypatch.setattr(lamps, "follow_outwards", lambda *given: given[-1])
    reduced = reduce_pair(shadowed(warm_to_cool[[0, 2]]))

    found = estimate_lamps(reduced, model, 2, "best", pinned(warm_to_cool[:pins]))

    assert (found.rival_deg > 5) == told


def test_a_forbidden_lamp_that_is_missed_is_told(
    shadowed: Shadowed, model: Model, warm_to_cool: Floats64, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By what the fit is worth without what is known."""
    true = model.lamp_matrix(warm_to_cool[:2])
    white = true[0] @ model.flash_white
    known = replace(nothing_known(model.flash_white), forbidden=white[None] / np.linalg.norm(white))

    def fit(given: FitInput, *_: object) -> Fit:
        return Fit(true, 0.0 if len(given.known.forbidden) else -100.0)

    monkeypatch.setattr(lamps, "fit_matrices", fit)
    reduced = reduce_pair(shadowed(warm_to_cool[:2]))

    (warning,) = estimate_lamps(reduced, model, 2, "best", known).contradictions
    assert warning.code == Code.FORBIDDEN_LAMP_SHOWS
    assert estimate_lamps(reduced, model, 2, "best").contradictions == ()


def test_a_forbidden_lamp_that_cannot_be_avoided_is_an_error(
    shadowed: Shadowed, model: Model, warm_to_cool: Floats64, monkeypatch: pytest.MonkeyPatch
) -> None:
    true = model.lamp_matrix(warm_to_cool[:2])
    monkeypatch.setattr(lamps, "fit_matrices", lambda *_: Fit(true, np.inf))
    with pytest.raises(OptionError, match="Whatever 2 lamps explain the photograph"):
        estimate_lamps(reduce_pair(shadowed(warm_to_cool[:2])), model, 2, "best")
