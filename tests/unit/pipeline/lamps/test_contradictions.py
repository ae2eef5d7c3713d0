from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.lamps import contradictions as module
from pipeline.lamps.contradictions import contradictions, needless_pins, other_light
from pipeline.light.model import Model
from pipeline.matrixfit.evidence import evidence_of_surfaces
from pipeline.matrixfit.fit import Fit, FitInput, fit_pin
from pipeline.matrixfit.known import Known, Pin, nothing_known
from pipeline.run_warnings import Code, RunWarning


@pytest.fixture
def seen(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    warm_to_cool: Floats64,
) -> FitInput:
    return fit_input(shadowed(warm_to_cool[:2]))


@pytest.fixture
def pin(model: Model, surfaces: Floats64) -> Callable[..., Pin]:
    """Pin lamps by surfaces of which each shows one of them, in turn."""

    def of_lamps(*coefficients: Floats64) -> Pin:
        matrices = model.lamp_matrix(np.array(coefficients))
        light = np.einsum("nkl,nl->nk", np.resize(matrices, (len(surfaces), 3, 3)), surfaces)
        return fit_pin(evidence_of_surfaces(surfaces, light), model, True)

    return of_lamps


def known(model: Model, *pins: Pin) -> Known:
    return replace(nothing_known(model.flash_white), pinned=pins)


def told(seen: FitInput, given: Known, found: Fit, free: Fit) -> list[RunWarning]:
    """What contradicts what is given."""
    return contradictions(replace(seen, known=given), found, free)


def test_where_all_agrees_nothing_is_said(
    seen: FitInput, model: Model, warm_to_cool: Floats64, pin: Callable[..., Pin]
) -> None:
    true = model.lamp_matrix(warm_to_cool[:2])
    pins = known(model, pin(warm_to_cool[0]), pin(warm_to_cool[1]))
    assert told(seen, pins, Fit(true, -100.0), Fit(true, -119.0)) == []


def test_a_pin_that_is_explained_much_worse_is_doubted(
    seen: FitInput, model: Model, warm_to_cool: Floats64, pin: Callable[..., Pin]
) -> None:
    """The one that is farthest from all lamps found without it."""
    true = model.lamp_matrix(warm_to_cool[:2])
    pins = known(model, pin(warm_to_cool[0]), pin(warm_to_cool[2]))
    found = Fit(pins.matrices, -100.0)

    (said,) = told(seen, pins, found, Fit(true, -121.0))

    assert "speaks against pinned lamp 2" in said.message
    assert (said.code, said.figures) == (Code.PIN_CONTRADICTED, {"pin": 2})


def test_one_spectrum_that_is_found_anyway_does_not_excuse_another(
    seen: FitInput, model: Model, warm_to_cool: Floats64, pin: Callable[..., Pin]
) -> None:
    true = model.lamp_matrix(warm_to_cool[:2])
    right, wrong = (replace(pin(warm_to_cool[k]), of_area=False) for k in (1, 2))
    found, free = Fit(true, -100.0), Fit(true, -200.0)

    (said,) = told(seen, known(model, right, wrong), found, free)

    assert said.figures == {"pin": 2}
    # a lamp of any place is found, and chromaticities do not tell T from −T
    for lamps in (true, true[::-1], -true):
        assert told(seen, known(model, right), found, Fit(lamps, -200.0)) == []


def test_a_spectrum_near_a_lamp_that_is_found_anyway_is_not_doubted(
    seen: FitInput, model: Model, warm_to_cool: Floats64, pin: Callable[..., Pin]
) -> None:
    for shift, of_area, doubted in ((0.03, False, False), (0.08, False, True), (0.03, True, True)):
        pins = known(model, replace(pin(warm_to_cool[0]), of_area=of_area))
        near = model.lamp_matrix(warm_to_cool[:2] + np.array([shift, 0.0, 0.0]))
        said = told(seen, pins, Fit(pins.matrices, 0.0), Fit(near, -100.0))
        assert bool(said) is doubted


@pytest.mark.parametrize(("pins", "cost"), [(1, 120.0), (2, 240.0)])
def test_a_spectrum_near_a_lamp_is_doubted_where_it_costs_much(
    seen: FitInput,
    model: Model,
    warm_to_cool: Floats64,
    pin: Callable[..., Pin],
    pins: int,
    cost: float,
) -> None:
    """Right pins may cost a little; what is farthest from all lamps found without it is told."""
    free = model.lamp_matrix(warm_to_cool[:2] + np.array([[0.02, 0.0, 0.0], [0.03, 0.0, 0.0]]))
    near = known(model, *(replace(pin(warm_to_cool[k]), of_area=False) for k in (1, 0)[:pins]))

    for off, doubted in ((-1.0, False), (1.0, True)):
        said = told(seen, near, Fit(near.matrices, 0.0), Fit(free, -cost - off))
        assert [(one.code, one.figures) for one in said] == (
            [(Code.PIN_CONTRADICTED, {"pin": 1})] if doubted else []
        )
    # a right one may cost as much, but is found nearly where it is
    true = model.lamp_matrix(warm_to_cool[:2] + np.array([0.005, 0.0, 0.0]))
    assert told(seen, near, Fit(near.matrices, 0.0), Fit(true, -2 * cost)) == []


@pytest.mark.parametrize(
    ("costs", "pin"), [((100.0, 1.0, 50.0), None), ((100.0, -1.0, 50.0), 2), ((-1, 0, -2), 3)]
)
def test_a_pin_that_the_others_do_without_is_doubted(
    model: Model, warm_to_cool: Floats64, costs: tuple[float, ...], pin: int | None
) -> None:
    lamps = model.lamp_matrix(warm_to_cool)
    fewer = [Fit(np.delete(lamps, left_out, 0), cost) for left_out, cost in enumerate(costs)]

    said = needless_pins(Fit(lamps, 0.0), fewer)

    assert [(one.code, one.figures) for one in said] == (
        [] if pin is None else [(Code.PIN_CONTRADICTED, {"pin": pin})]
    )
    assert all(f"Nothing in the photograph shows pinned lamp {pin}" in one.message for one in said)


def test_an_area_of_several_lamps_is_doubted(
    seen: FitInput, model: Model, warm_to_cool: Floats64, pin: Callable[..., Pin]
) -> None:
    mixed, right = pin(warm_to_cool[0], warm_to_cool[2]), pin(warm_to_cool[1])
    pins = known(model, right, mixed)
    found = Fit(pins.matrices, -100.0)

    (said,) = told(seen, pins, found, Fit(found.matrices, -200.0))

    assert "The area of pinned lamp 2 seems to be lit by more than this lamp" in said.message
    assert (said.code, said.figures) == (Code.PIN_NOT_PURE, {"pin": 2})


def test_only_areas_show_other_light(
    seen: FitInput, model: Model, warm_to_cool: Floats64, pin: Callable[..., Pin]
) -> None:
    """By chromaticities 0.02 off; those of spectra are regressed, and never fit."""
    found = Fit(model.lamp_matrix(warm_to_cool[:2]), -100.0)
    for shift, of_area, doubted in ((0.018, True, False), (0.022, True, True), (0.1, False, False)):
        one = replace(pin(warm_to_cool[0]), of_area=of_area)
        data = replace(one.term.data, u=one.term.data.u + np.array([shift, 0.0]))
        pins = known(model, replace(one, term=replace(one.term, data=data)))
        assert bool(told(seen, pins, found, found)) is doubted


def test_an_area_that_the_lamp_found_does_not_explain_is_doubted(
    seen: FitInput, model: Model, warm_to_cool: Floats64, pin: Callable[..., Pin]
) -> None:
    pins = known(model, pin(warm_to_cool[0]))
    found = Fit(model.lamp_matrix(warm_to_cool[[1, 2]]), -100.0)

    (said,) = told(seen, pins, found, found)

    assert "The area of pinned lamp 1" in said.message


def test_a_forbidden_lamp_that_is_missed_is_doubted(
    seen: FitInput, model: Model, warm_to_cool: Floats64
) -> None:
    nothing = nothing_known(model.flash_white)
    lamps = model.lamp_matrix(warm_to_cool[:2])

    (said,) = told(seen, nothing, Fit(lamps, -100.0), Fit(lamps, -121.0))

    assert "as if a forbidden lamp were there" in said.message
    assert said.code == Code.FORBIDDEN_LAMP_SHOWS


@pytest.mark.parametrize(
    ("left", "doubted"),
    [((2.0, 1.0), True), ((1.55, 1.0), True), ((1.45, 1.0), False), ((1.0, 2.0), False)],
)
@pytest.mark.parametrize("scene", ["three lamps", "without edges"])
def test_of_three_lamps_or_without_edges_what_is_left_unexplained_decides(
    seen: FitInput,
    exact: Callable[..., Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
    pin: Callable[..., Pin],
    monkeypatch: pytest.MonkeyPatch,
    left: tuple[float, float],
    doubted: bool,
    scene: str,
) -> None:
    """With the pin, and without it: half more will do."""
    count = 3
    if scene == "without edges":
        count, seen = 2, fit_input(exact(warm_to_cool[:2])[0])
    # the pinned lamp is none of those found without it
    found, free = (model.lamp_matrix(warm_to_cool[::step][:count]) for step in (1, -1))
    monkeypatch.setattr(module, "unexplained", lambda _r, _e, m: left[int(m is free)])
    pins = known(model, pin(warm_to_cool[0]))
    assert bool(told(seen, pins, Fit(found, 0.0), Fit(free, -100.0))) is doubted


def test_other_light_is_a_distance_of_chromaticities_beyond_the_noise(
    warm_to_cool: Floats64, pin: Callable[..., Pin]
) -> None:
    one = pin(warm_to_cool[0])
    assert other_light(one, one.matrix) < 1e-4
    data = replace(one.term.data, u=one.term.data.u + np.array([0.03, 0.04]))
    shifted = replace(one, term=replace(one.term, data=data))
    assert other_light(shifted, one.matrix) == pytest.approx(0.05, abs=1e-3)
    noisy = replace(data, covariance=data.covariance + np.array([0.0004, 0.0, 0.0005]))
    noisy_pin = replace(one, term=replace(one.term, data=noisy))
    left = (0.05**2 + 0.0009 * np.log(0.2)) ** 0.5  # a fifth of such noise is farther away
    assert other_light(noisy_pin, one.matrix) == pytest.approx(left, abs=1e-3)
    loud = replace(data, covariance=data.covariance + np.array([0.01, 0.0, 0.01]))
    assert other_light(replace(one, term=replace(one.term, data=loud)), one.matrix) == 0
