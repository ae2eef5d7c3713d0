from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import UnusablePairError
from pipeline.light.model import Model
from pipeline.matrixfit import evidence, fit
from pipeline.matrixfit.fit import Fit, FitInput, first_fit, fit_matrices
from pipeline.matrixfit.known import nothing_known
from pipeline.matrixfit.objective import Term, make_terms, without_mirrors

Off = Callable[[Floats64, Floats64], float]
Fitted = Callable[[Any, int], Fit]

SETS = [(0,), (2,), (0, 2), (0, 1), (1, 2), (0, 1, 2)]


@pytest.fixture
def fitted(fit_input: Callable[..., FitInput]) -> Fitted:
    """Fit a number of lamps to a pair."""
    return lambda pair, lamps: fit_matrices(fit_input(pair), lamps)


@pytest.mark.parametrize("which", SETS)
@pytest.mark.parametrize(("scene", "limit"), [("shadowed", 0.006), ("outline", 0.04)])
def test_matrices_are_recovered(
    shadowed: Callable[[Floats64], Any],
    exact: Callable[..., Any],
    fitted: Fitted,
    model: Model,
    warm_to_cool: Floats64,
    which: tuple[int, ...],
    scene: str,
    limit: float,
    off: Off,
) -> None:
    true = warm_to_cool[list(which)]
    pair = shadowed(true) if scene == "shadowed" else exact(true)[0]

    found = fitted(pair, len(which))

    assert found.matrices.shape == (len(which), 3, 3)
    np.testing.assert_allclose(np.linalg.norm(found.matrices, axis=(1, 2)), 1)
    assert off(found.matrices, model.lamp_matrix(true)) < limit


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_what_is_mirrored_has_the_colour_of_the_flash_on_white(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    scale: float,
) -> None:
    made: list[Floats64] = []

    def noting(*given: Any) -> list[Term]:
        terms = make_terms(*given)
        made.append(terms[1].mirrored)
        return terms

    monkeypatch.setattr(fit, "make_terms", noting)
    known = nothing_known(scale * model.flash_white)

    first_fit(fit_input(shadowed(warm_to_cool[:2]), known), 2)

    white = model.flash_white / model.flash_white.sum()
    np.testing.assert_allclose(made, [white])


@pytest.mark.parametrize(
    ("mirrored", "rendered", "again"),
    [(0.0, False, False), (0.2, False, False), (0.8, False, True), (0.8, True, False)],
)
def test_no_mirror_takes_the_place_of_its_lamp(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    mirrored: float,
    rendered: bool,
    again: bool,
) -> None:
    """A share of the differences has a lamp's own colour, on surfaces of many."""
    given = fit_input(replace(shadowed(warm_to_cool[[0, 2]]), rendered=rendered))
    own = model.lamp_matrix(warm_to_cool[2]) @ model.flash_white
    data = given.evidence.differences
    some = np.arange(len(data)) % 10 < 10 * mirrored
    u = np.where(some[:, None], own[:2] / own.sum(), data.u)
    evidence = replace(given.evidence, differences=replace(data, u=u))
    given = replace(given, evidence=evidence)

    found = first_fit(given, 2)

    monkeypatch.setattr(
        fit, "make_terms", lambda *given: [without_mirrors(term) for term in make_terms(*given)]
    )
    matt = first_fit(given, 2)
    assert np.array_equal(found.matrices, matt.matrices) == again


@pytest.mark.parametrize(
    ("which", "outside", "limit"),
    [((0, 2), 0.0, 0.004), ((0, 1), 0.0, 0.002), ((1, 2), 0.0, 0.009), ((0, 1, 2), 0.1, 0.06)],
)
def test_an_outline_is_followed_finely(
    pair_of: Callable[..., Any],
    fitted: Fitted,
    model: Model,
    flash_part: Floats64,
    shares_of: Callable[[int], Floats64],
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    which: tuple[int, ...],
    outside: float,
    limit: float,
    off: Off,
) -> None:
    """Also that of lamps that lie outside the model's space."""
    monkeypatch.setattr(fit, "mean_left_over", lambda *_: 1.0)  # or nothing would be fitted
    theta = model.prior.coordinates(model.lamp_matrix(warm_to_cool[list(which)]))
    theta[:, 3] += outside * np.linspace(1, -1, len(which))
    true = model.prior.matrices(theta)
    light = np.einsum("nhw,nkl,hwl->hwk", shares_of(len(which)), true, flash_part)

    found = fitted(pair_of(light, flash_part), len(which))

    assert off(found.matrices, true) < limit


@pytest.mark.parametrize("which", [(0, 2), (0, 1, 2)])
def test_an_exact_outline_is_taken_as_it_is(
    pair_of: Callable[..., Any],
    fitted: Fitted,
    model: Model,
    warm_to_cool: Floats64,
    which: tuple[int, ...],
) -> None:
    """One surface, light without edges, and pixels that each lamp lights alone."""
    true = model.lamp_matrix(warm_to_cool[list(which)])
    v, u = np.mgrid[:120, :160] / np.array([120, 160])[:, None, None]
    spots = [(0.1, 0.1), (0.9, 0.1), (0.5, 0.9)][: len(which)]
    z = np.array([np.clip(0.7 - np.hypot(u - x, v - y), 0.0, None) for x, y in spots])
    part = np.array([0.3, 0.5, 0.4]) * (0.6 + 0.4 * u[..., None])

    found = fitted(pair_of(np.einsum("nhw,nkl,hwl->hwk", z, true, part), part), len(which))

    seen, wanted = (light @ part[0, 0] for light in (found.matrices, true))
    cosines = (seen @ wanted.T) / np.linalg.norm(seen, axis=1)[:, None]
    cosines /= np.linalg.norm(wanted, axis=1)
    assert np.degrees(np.arccos(np.clip(cosines.max(axis=0), -1, 1))).max() < 0.02


def test_terminators_show_lamps_that_the_outline_does_not_reach(
    pair_of: Callable[..., Any],
    fitted: Fitted,
    model: Model,
    warm_to_cool: Floats64,
) -> None:
    """One lamp shines everywhere, two end at lines: the published triangle is exact and wrong."""
    true = model.lamp_matrix(warm_to_cool)
    v, u = np.mgrid[:120, :160] / np.array([120, 160])[:, None, None]
    z = np.array([np.clip(0.55 - u, 0.0, None), np.clip(v - 0.45, 0.0, None), 0.2 + 0.1 * u])
    part = np.array([0.3, 0.5, 0.4]) * (0.6 + 0.4 * u[..., None])

    found = fitted(pair_of(np.einsum("nhw,nkl,hwl->hwk", z, true, part), part), 3)

    seen, wanted = (light @ part[0, 0] for light in (found.matrices, true))
    cosines = (seen @ wanted.T) / np.linalg.norm(seen, axis=1)[:, None]
    cosines /= np.linalg.norm(wanted, axis=1)
    assert np.degrees(np.arccos(np.clip(cosines.max(axis=0), -1, 1))).max() < 0.5


@pytest.mark.parametrize("asked", [True, False])
def test_pools_show_lamps_that_the_outline_does_not_reach(
    pair_of: Callable[..., Any],
    fitted: Fitted,
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    asked: bool,
) -> None:
    """Three lamps before a wall, none of them alone anywhere: the published triangle is exact."""
    if not asked:
        monkeypatch.setattr(evidence, "find_pools", lambda _: [])
    true = model.lamp_matrix(warm_to_cool)
    v, u = np.mgrid[:120, :160] / 160.0
    spots = [(0.2, 0.3), (0.5, 0.45), (0.8, 0.3)]
    z = np.array([(1 + ((u - x) ** 2 + (v - y) ** 2) / 0.15**2) ** -1.5 for x, y in spots])
    part = np.array([0.3, 0.5, 0.4]) * (0.9 + 0.1 * u[..., None])

    found = fitted(pair_of(np.einsum("nhw,nkl,hwl->hwk", z, true, part), part), 3)

    seen, wanted = (light @ part[0, 0] for light in (found.matrices, true))
    cosines = (seen @ wanted.T) / np.linalg.norm(seen, axis=1)[:, None]
    cosines /= np.linalg.norm(wanted, axis=1)
    worst = float(np.degrees(np.arccos(np.clip(cosines.max(axis=0), -1, 1))).max())
    assert (worst < 0.5) is asked


def test_three_lamps_that_leave_much_are_found_otherwise(
    shadowed: Callable[[Floats64], Any],
    fitted: Fitted,
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    off: Off,
) -> None:
    true = model.lamp_matrix(warm_to_cool)
    wrong = np.roll(true, 1, axis=2) / np.linalg.norm(true, axis=(1, 2), keepdims=True)
    likeliest = fitted(shadowed(warm_to_cool), 3).cost
    monkeypatch.setattr(fit, "search", lambda *_: (wrong, -1e9))

    found = fitted(shadowed(warm_to_cool), 3)

    assert off(wrong, true) > 0.1
    assert off(found.matrices, true) < 0.0065
    assert found.cost == pytest.approx(likeliest, abs=5)


@pytest.mark.parametrize("which", [[0, 2], [0, 1, 2]])
@pytest.mark.parametrize(
    ("rendered", "cost", "corrected"),
    [(False, 0.0, True), (False, -1e9, False), (True, 0.0, False)],
)
def test_several_lamps_are_searched_from_the_published_ones_too(
    shadowed: Callable[[Floats64], Any],
    fit_input: Callable[..., FitInput],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    off: Off,
    which: list[int],
    rendered: bool,
    cost: float,
    corrected: bool,
) -> None:
    """The likelier ones are taken, but where a camera's rendering bent the chromaticities."""
    true = model.lamp_matrix(warm_to_cool[which])
    wrong = np.roll(true, 1, axis=2) / np.linalg.norm(true, axis=(1, 2), keepdims=True)
    monkeypatch.setattr(fit, "search", lambda *_: (wrong, cost))
    pair = replace(shadowed(warm_to_cool[which]), rendered=rendered)

    found = first_fit(fit_input(pair), len(which))

    assert off(wrong, true) > 0.1
    assert (off(found.matrices, true) < 0.006) == corrected
    assert corrected or np.array_equal(found.matrices, wrong)
    assert len(found.passed_over) == (not rendered or len(which) == 3)
    for other in found.passed_over:
        assert (off(other, true) < 0.006) != corrected


def test_what_the_search_passes_over_counts_where_three_lamps_leave_much(
    shadowed: Callable[[Floats64], Any],
    fitted: Fitted,
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    off: Off,
) -> None:
    """Likelier lamps give way to those that the search itself found."""
    true = model.lamp_matrix(warm_to_cool)
    true /= np.linalg.norm(true, axis=(1, 2), keepdims=True)
    wrong = np.roll(true, 1, axis=2)
    monkeypatch.setattr(fit, "search", lambda *_: (true, 0.0))
    monkeypatch.setattr(fit, "follow", lambda *_: (wrong, -1e9))
    monkeypatch.setattr(fit, "_otherwise", lambda *_: [np.roll(true, 2, axis=2)])

    found = fitted(shadowed(warm_to_cool), 3)

    assert off(found.matrices, true) < 1e-12
    assert off(wrong, true) > 0.1


@pytest.mark.parametrize("scene", ["shadowed", "outline", "much is left"])
@pytest.mark.parametrize("which", [[0, 2], [0, 1, 2]])
def test_without_published_lamps_others_are_found_as_they_are(
    shadowed: Callable[[Floats64], Any],
    exact: Callable[..., Any],
    fitted: Fitted,
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    off: Off,
    which: list[int],
    scene: str,
) -> None:
    def none(*_: object) -> Floats64:
        raise UnusablePairError("The light of hardly any pixel agrees with that of another.")

    monkeypatch.setattr(fit, "lights_of_pair", none)
    monkeypatch.setattr(fit, "_LITTLE", 0.0 if scene == "much is left" else fit._LITTLE)
    true = warm_to_cool[which]

    found = fitted(exact(true)[0] if scene == "outline" else shadowed(true), len(which))

    # where much is left, what leaves least may be those of the outline
    assert off(found.matrices, model.lamp_matrix(true)) < (0.006 if scene == "shadowed" else 0.06)


def test_an_outline_is_not_judged_by_its_few_differences(
    exact: Callable[..., Any],
    fitted: Fitted,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair = exact(warm_to_cool)[0]
    monkeypatch.setattr(fit, "mean_left_over", lambda *_: 1.0)  # or nothing would be fitted
    alone = fitted(pair, 3)
    monkeypatch.setattr(fit, "unexplained", lambda *_: 9.0)
    monkeypatch.setattr(fit, "_otherwise", lambda *_: [np.tile(np.eye(3), (3, 1, 1))])

    found = fitted(pair, 3)

    np.testing.assert_array_equal(found.matrices, alone.matrices)


def test_a_lamp_need_not_be_of_the_model(
    fitted: Fitted,
    model: Model,
    pair_of: Callable[..., Any],
    flash_part: Floats64,
    warm_to_cool: Floats64,
    off: Off,
) -> None:
    """A lamp a little outside the model's space is found nearer than the model can."""
    inside = model.prior.coordinates(model.lamp_matrix(warm_to_cool[:1]))
    theta = inside.copy()
    theta[0, 3] += 0.06
    true = model.prior.matrices(theta / np.linalg.norm(theta))

    found = fitted(pair_of(0.5 * flash_part @ true[0].T, flash_part), 1)

    assert off(found.matrices, true) < 0.5 * off(model.prior.matrices(inside), true)


def test_the_same_pair_gives_the_same_fit(
    shadowed: Callable[[Floats64], Any], fitted: Fitted, warm_to_cool: Floats64
) -> None:
    first, second = (fitted(shadowed(warm_to_cool), 3) for _ in range(2))

    np.testing.assert_array_equal(first.matrices, second.matrices)
    assert first.cost == second.cost


@pytest.mark.parametrize("which", [(0,), (0, 2), (0, 1, 2)])
def test_the_true_number_of_lamps_costs_least(
    shadowed: Callable[[Floats64], Any],
    fitted: Fitted,
    warm_to_cool: Floats64,
    which: tuple[int, ...],
) -> None:
    pair = shadowed(warm_to_cool[list(which)])

    costs = [fitted(pair, lamps).cost for lamps in (1, 2, 3)]

    assert min(costs) == pytest.approx(costs[len(which) - 1], abs=1e-3)


@pytest.mark.parametrize("lamps", [2, 3])
def test_more_lamps_than_colours_are_found_alike(
    pair_of: Callable[..., Any], fitted: Fitted, model: Model, warm_to_cool: Floats64, lamps: int
) -> None:
    part = np.tile(np.array([0.3, 0.5, 0.4]), (40, 60, 1))
    light = part @ model.lamp_matrix(0.5 * warm_to_cool[0]).T

    found = fitted(pair_of(light, part), lamps)

    assert found.matrices.shape == (lamps, 3, 3)
    seen, true = found.matrices @ part[0, 0], light[0, 0]
    cosines = seen @ true / np.linalg.norm(seen, axis=1) / np.linalg.norm(true)
    assert cosines.max() > 0.9999
