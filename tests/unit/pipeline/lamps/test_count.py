from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.images.noise import Noise
from pipeline.lamps import count
from pipeline.lamps.count import Count, count_lamps, signs_of_fourth
from pipeline.light.model import Model
from pipeline.matrixfit.evidence import gather_evidence
from pipeline.matrixfit.fit import Fit, FitInput, first_fit, fit_matrices, fit_pin
from pipeline.matrixfit.known import nothing_known
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.vectors import unit
from tests.reduced_pairs import reduced_pair

Shadowed = Callable[[Floats64], Any]

SETS = [(0,), (1,), (2,), (0, 2), (0, 1), (1, 2), (0, 1, 2)]
FOURTH = np.array([[0.69, 0.3, 0.65]])


@pytest.fixture
def counted(fit_input: Callable[..., FitInput]) -> Callable[[Any], Count]:
    """Count the lamps of a pair by their fits."""

    def of_pair(pair: Any) -> Count:
        given = fit_input(pair)
        return count_lamps(given, partial(first_fit, given))

    return of_pair


@pytest.mark.parametrize("which", SETS)
@pytest.mark.parametrize("scene", ["shadowed", "smooth"])
def test_lamps_are_counted(
    counted: Callable[[Any], Count],
    exact: Callable[..., tuple[Any, Floats64]],
    shadowed: Shadowed,
    warm_to_cool: Floats64,
    which: tuple[int, ...],
    scene: str,
) -> None:
    true = warm_to_cool[list(which)]

    found = counted(shadowed(true) if scene == "shadowed" else exact(true)[0])

    assert found.number == len(which)
    assert 0.9 < found.confidence <= 1


def test_one_lamp_need_not_fit_the_model(
    counted: Callable[[Any], Count], pair_of: Callable[..., Any], flash_part: Floats32
) -> None:
    matrix = np.array([[0.8, 0.15, 0.0], [0.1, 0.4, 0.1], [0.0, 0.2, 0.3]])

    assert counted(pair_of(flash_part @ matrix.T, flash_part)).number == 1


def test_signs_of_a_fourth_lamp_are_those_of_four(
    fit_input: Callable[..., FitInput], shadowed: Shadowed, warm_to_cool: Floats64
) -> None:
    for lamps, more in ((warm_to_cool, False), (np.vstack([warm_to_cool, FOURTH]), True)):
        given = fit_input(shadowed(lamps))

        assert signs_of_fourth(given, fit_matrices(given, 3).matrices) is more


@pytest.mark.parametrize(
    ("left", "gain", "more"), [(1.44, 44.0, False), (1.46, 44.0, True), (1.44, 46.0, True)]
)
@pytest.mark.parametrize("rendered", [False, True])
def test_either_sign_of_a_fourth_lamp_will_do(
    fit_input: Callable[..., FitInput],
    shadowed: Shadowed,
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    left: float,
    gain: float,
    more: bool,
    rendered: bool,
) -> None:
    pair = replace(shadowed(warm_to_cool), rendered=rendered)
    monkeypatch.setattr(count, "unexplained", lambda *_: left)
    monkeypatch.setattr(count, "gain_of_fourth", lambda *_: gain)

    found = signs_of_fourth(fit_input(pair), model.lamp_matrix(warm_to_cool))

    assert found is more


@pytest.mark.parametrize(("degrees", "more"), [(3.0, False), (4.0, True)])
@pytest.mark.parametrize("sign", [1, -1])  # a fit's matrices may have either
def test_no_fourth_lamp_is_told_where_the_third_is_another_again(
    fit_input: Callable[..., FitInput],
    shadowed: Shadowed,
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    degrees: float,
    more: bool,
    sign: int,
) -> None:
    monkeypatch.setattr(count, "unexplained", lambda *_: 9.0)
    warm, _, cool = warm_to_cool
    aside, angle = unit(warm - (warm @ cool) * cool), np.radians(degrees)
    again = np.cos(angle) * cool + np.sin(angle) * aside
    matrices = model.lamp_matrix(np.stack([cool, warm, again]))

    found = signs_of_fourth(fit_input(shadowed(warm_to_cool)), sign * matrices)

    assert found is more


def test_no_fourth_lamp_is_told_where_edges_tell_nothing(
    fit_input: Callable[..., FitInput],
    exact: Callable[..., tuple[Any, Floats64]],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(count, "unexplained", lambda *_: 9.0)
    given = fit_input(exact(warm_to_cool)[0])

    assert not signs_of_fourth(given, model.lamp_matrix(warm_to_cool))


@pytest.mark.parametrize(("differences", "number"), [(600, 3), (60, 2)])
def test_few_differences_say_little_of_a_third_lamp(
    fit_input: Callable[..., FitInput],
    shadowed: Shadowed,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    differences: int,
    number: int,
) -> None:
    """All of them show neither of two lamps."""
    monkeypatch.setattr(count, "share_of_third", lambda *_: 1.0)
    monkeypatch.setattr(count, "left_over", lambda *_: 0.0)
    given = fit_input(shadowed(warm_to_cool[[0, 2]]))
    fits = {lamps: first_fit(given, lamps) for lamps in (1, 2, 3)}
    found = given.evidence.differences
    again = np.arange(differences) % len(found)
    found = replace(found, **{key: value[again] for key, value in vars(found).items()})
    given = replace(given, evidence=replace(given.evidence, differences=found))

    assert count_lamps(given, fits.__getitem__).number == number


def test_nearly_equal_lamps_count_as_one_and_less_surely(
    counted: Callable[[Any], Count], shadowed: Shadowed, warm_to_cool: Floats64
) -> None:
    warm, _, cool = warm_to_cool
    found = [
        counted(shadowed(np.array([warm, (1 - part) * warm + part * cool])))
        for part in (0.0, 0.02, 0.5)
    ]

    assert [one.number for one in found] == [1, 1, 2]
    assert found[1].confidence <= found[0].confidence


def test_noise_that_is_known_does_not_make_a_lamp(
    counted: Callable[[Any], Count],
    pair_of: Callable[..., Any],
    shadowed: Shadowed,
    warm_to_cool: Floats64,
) -> None:
    clean = shadowed(warm_to_cool[:1])
    drawn = np.random.default_rng(5).normal(0, 0.003, clean.no_flash.shape)
    noise = Noise(np.full(3, 1e-8), np.full(3, 0.003**2))
    noisy = pair_of(
        clean.no_flash + drawn,
        clean.flash - clean.no_flash,
        no_flash_noise=noise,
        flash_noise=noise,
    )

    assert counted(noisy).number == 1


def costs(*values: float) -> Callable[[int], Fit]:
    """Fits of given costs, with lamps that leave nothing off."""
    return lambda lamps: Fit(np.tile(np.eye(3), (lamps, 1, 1)), values[lamps - 1])


@pytest.fixture
def by_costs(
    fit_input: Callable[..., FitInput],
    pair_of: Callable[..., Any],
    flash_part: Floats32,
    monkeypatch: pytest.MonkeyPatch,
) -> Callable[..., Count]:
    """Count by the costs of one to three lamps alone, which leave nothing off."""
    monkeypatch.setattr(count, "is_gloss", lambda *_: False)
    monkeypatch.setattr(count, "scatter_within_colours", lambda *_: 1.0)
    monkeypatch.setattr(count, "share_beside", lambda *_: 0.09)
    given = fit_input(pair_of(0.5 * flash_part, flash_part))
    assert not len(given.evidence.differences)
    pin = fit_pin(given.evidence.pixels, given.model, of_area=True)

    def run(*values: float, pins: int = 0) -> Count:
        fit = costs(*values)
        known = replace(given.known, pinned=pins * (pin,))
        return count_lamps(replace(given, known=known), fit)

    return run


@pytest.mark.parametrize(
    ("second", "third", "number"),
    [(299, 999, 1), (301, -900, 2), (900, -556, 2), (900, -554, 3), (301, 999, 3)],
)
def test_a_lamp_is_counted_by_what_it_gains(
    by_costs: Callable[..., Count], second: float, third: float, number: int
) -> None:
    """A second lamp gains 300 at least; of an outline a third may lose 3.7 times 150."""
    found = by_costs(0, -second, -second - third)

    assert found.number == number
    assert 0.5 <= found.confidence < 0.6


@pytest.mark.parametrize(("left", "number", "confidence"), [(0.099, 3, 1.0), (0.101, 2, 0.5)])
def test_a_third_lamp_with_which_more_is_left_is_none(
    by_costs: Callable[..., Count],
    monkeypatch: pytest.MonkeyPatch,
    left: float,
    number: int,
    confidence: float,
) -> None:
    """Whatever the likelihood gains."""
    monkeypatch.setattr(count, "left_over", lambda _, matrices: left if len(matrices) == 3 else 0.1)

    found = by_costs(0, -9999, -99999)

    assert found.number == number
    assert found.confidence == pytest.approx(confidence, abs=0.01)


@pytest.mark.parametrize(
    ("second", "gloss", "within", "rendered", "found"),
    [
        (301, True, 1.0, False, (1, 0.8)),
        (301, False, 1.0, False, (2, 0.5)),
        (1499, True, 1.0, False, (1, 0.8)),
        (1501, True, 1.0, False, (2, 1.0)),
        (1499, True, 1.0, True, (2, 1.0)),
        (299, False, 1.0, False, (1, 0.5)),
        (301, False, 0.039, False, (1, 0.8)),
        (9999, False, 0.039, False, (1, 0.8)),
        (9999, False, 0.041, False, (2, 1.0)),
        (9999, False, 0.039, True, (2, 1.0)),
        (299, False, 0.0, False, (1, 0.5)),
    ],
)
def test_gloss_or_colours_that_explain_as_much_are_no_lamp(
    fit_input: Callable[..., FitInput],
    pair_of: Callable[..., Any],
    flash_part: Floats32,
    monkeypatch: pytest.MonkeyPatch,
    second: float,
    gloss: bool,
    within: float,
    rendered: bool,
    found: tuple[int, float],
) -> None:
    """Gloss where the second lamp gains little, and both where the file's colours are linear."""
    pair = replace(pair_of(0.5 * flash_part, flash_part), rendered=rendered)
    monkeypatch.setattr(count, "is_gloss", lambda *_: gloss)
    monkeypatch.setattr(count, "scatter_within_colours", lambda *_: within)
    monkeypatch.setattr(count, "left_over", lambda *_: 0.0)
    fit = costs(0, -second, 900 - second)

    counts = count_lamps(fit_input(pair), fit)

    assert (counts.number, round(counts.confidence, 1)) == found


@pytest.mark.parametrize("lamp", ["A", "FL2", "LED-B1"])
def test_many_paints_under_one_lamp_make_no_second(camera: Camera, model: Model, lamp: str) -> None:
    """Sixty measured surfaces in tiles, without noise: no matrix takes all of them to its light."""
    rng = np.random.default_rng(4)
    surfaces = reflectance_spectra()[rng.choice(len(reflectance_spectra()), 60, replace=False)]
    tiles = np.kron(rng.integers(0, 60, (12, 16)), np.ones((5, 5), int))
    seen = (surfaces @ (camera.sensitivities * find_light(light)).T for light in (lamp, "xenon"))
    light, flash = (colours[tiles] / colours.max() for colours in seen)
    reduced = reduced_pair(0.6 * light * np.linspace(0.3, 1, 80)[None, :, None], 0.5 * flash)
    nothing = nothing_known(model.flash_white)
    given = FitInput(reduced, gather_evidence(reduced), model, nothing)
    assert count_lamps(given, partial(first_fit, given)) == Count(1, 0.8)


@pytest.mark.parametrize(
    ("off", "beside", "third", "number"),
    [(0.1, 0.09, -121, 2), (0.1, 0.09, -119, 3), (0.0, 0.29, -215, 2), (0.0, 0.29, -213, 3)],
)
def test_what_two_lamps_do_not_explain_makes_up_for_what_a_third_loses(
    fit_input: Callable[..., FitInput],
    shadowed: Shadowed,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    off: float,
    beside: float,
    third: float,
    number: int,
) -> None:
    """A tenth of the differences off is worth 0.8 times 150, light beside both 1.3 for each e."""
    monkeypatch.setattr(count, "MANY", 1)
    monkeypatch.setattr(count, "share_of_third", lambda *_: off)
    monkeypatch.setattr(count, "share_beside", lambda *_: beside)
    monkeypatch.setattr(count, "left_over", lambda *_: 0.0)

    fit = costs(0, -900, -900 - third)
    found = count_lamps(fit_input(shadowed(warm_to_cool[:2])), fit)

    assert found.number == number
    assert 0.5 <= found.confidence < 0.55


@pytest.mark.parametrize(
    ("second", "third", "pins", "number", "confidence"),
    [
        (1.0, -1455.0, 2, 2, 0.99),
        (1.0, -554.0, 2, 3, 0.5),
        (1.0, 1.0, 3, 3, 1.0),
        (299.0, 999.0, 1, 1, 0.5),
    ],
)
def test_no_fewer_lamps_are_counted_than_are_known(
    by_costs: Callable[..., Count],
    second: float,
    third: float,
    pins: int,
    number: int,
    confidence: float,
) -> None:
    """And of what is known, no more is to be told: 0.5 belongs to a gain at the limit."""
    found = by_costs(0, -second, -second - third, pins=pins)

    assert found.number == number
    assert found.confidence == pytest.approx(confidence, abs=0.02)


@pytest.mark.parametrize(
    ("values", "number"),
    [
        ((0.0, np.inf, np.inf), 1),
        ((np.inf, -900.0, np.inf), 2),
        ((np.inf, np.inf, -900.0), 3),
        ((np.inf, np.inf, np.inf), 1),
    ],
)
def test_numbers_that_cannot_be_are_not_counted(
    by_costs: Callable[..., Count], values: tuple[float, ...], number: int
) -> None:
    """A forbidden lamp makes the cost of a number infinite."""
    found = by_costs(*values)

    assert found.number == number
    assert 0 <= found.confidence <= 1
    # where none can be, nothing was left to choose
    assert found.confidence == 1 or np.isfinite(values).any()


def test_counting_is_the_same_every_time(
    counted: Callable[[Any], Count], shadowed: Shadowed, warm_to_cool: Floats64
) -> None:
    pair = shadowed(warm_to_cool[[0, 2]])

    assert counted(pair) == counted(pair)


@pytest.mark.parametrize(
    ("rendered", "left", "number"),
    [
        (True, (0.16, 0.101, 0.101), 1),
        (True, (0.16, 0.101, 0.097), 2),
        (True, (0.16, 0.097, 0.2), 2),
        (True, (0.085, 0.081, 0.081), 1),
        (True, (0.085, 0.081, 0.079), 2),
        (True, (0.085, 0.079, 0.2), 2),
        (False, (0.16, 0.15, 0.15), 2),
    ],
)
def test_several_lamps_of_a_rendered_pair_lessen_what_is_left_over(
    counted: Callable[[Any], Count],
    shadowed: Shadowed,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    rendered: bool,
    left: tuple[float, float, float],
    number: int,
) -> None:
    """Where two and three leave much and hardly less than one, the curve makes them likely."""
    pair = replace(shadowed(warm_to_cool[[0, 2]]), rendered=rendered)
    monkeypatch.setattr(count, "left_over", lambda _, matrices: left[len(matrices) - 1])

    found = counted(pair)

    assert found.number == number
    assert (found.confidence == 0.5) == (number == 1)


@pytest.mark.parametrize(
    ("rendered", "gain", "number"),
    [(False, 299.0, 1), (False, 301.0, 2), (True, 599.0, 1), (True, 601.0, 2)],
)
def test_a_second_lamp_must_gain_twice_as_much_in_a_rendered_pair(
    fit_input: Callable[..., FitInput],
    shadowed: Shadowed,
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    rendered: bool,
    gain: float,
    number: int,
) -> None:
    given = fit_input(replace(shadowed(warm_to_cool), rendered=rendered))
    monkeypatch.setattr(count, "left_over", lambda *_: 0.0)
    monkeypatch.setattr(count, "share_of_third", lambda *_: 0.0)
    monkeypatch.setattr(count, "share_beside", lambda *_: 0.0)
    matrices = model.lamp_matrix(warm_to_cool)

    def fit(lamps: int) -> Fit:
        return Fit(matrices[:lamps], gain if lamps == 1 else 0.0)

    assert count_lamps(given, fit).number == number


@pytest.mark.parametrize(("rendered", "numbers"), [(True, {1}), (False, {2, 3})])
def test_a_rendering_that_bends_colours_does_not_make_a_lamp(
    counted: Callable[[Any], Count],
    pair_of: Callable[..., Any],
    shadowed: Shadowed,
    warm_to_cool: Floats64,
    rendered: bool,
    numbers: set[int],
) -> None:
    """A camera's curve rolls off what is bright, and the colours of one lamp drift apart."""
    clean = shadowed(warm_to_cool[:1])
    no_flash, flash = (1 - np.exp(-2 * image) for image in (clean.no_flash, clean.flash))

    found = counted(pair_of(no_flash, flash - no_flash, rendered=rendered))

    assert found.number in numbers
