from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import UnusablePairError
from pipeline.hui2018.lights import lights_of_pair
from pipeline.lamps import lamps
from pipeline.lamps.lamps import estimate_lamps
from pipeline.light.model import Model
from pipeline.matrixfit.fit import Fit
from pipeline.pair.reduced import reduce_pair
from tests.angles import angles

Exact = Callable[..., tuple[Any, Floats64]]
Shadowed = Callable[[Floats64], Any]


def whites(model: Model, coefficients: Floats64) -> Floats64:
    """What lamps of the model make of a white card."""
    return np.asarray(model.lamp_matrix(coefficients) @ model.flash_white)


@pytest.mark.parametrize("which", [(0,), (2,), (0, 2), (0, 1), (1, 2), (0, 1, 2)])
@pytest.mark.parametrize("automatic", [True, False], ids=["auto", "given"])
@pytest.mark.parametrize("scene", ["shadowed", "smooth"])
def test_lamps_of_the_model_are_found(
    exact: Exact,
    shadowed: Shadowed,
    model: Model,
    warm_to_cool: Floats64,
    which: tuple[int, ...],
    automatic: bool,
    scene: str,
) -> None:
    true = warm_to_cool[list(which)]
    pair = shadowed(true) if scene == "shadowed" else exact(true)[0]
    requested: Any = "auto" if automatic else len(which)

    found = estimate_lamps(reduce_pair(pair), model, requested, "best")

    assert len(found) == len(which)
    assert found.requested == requested
    assert found.coefficients.shape == (len(which), 3)
    np.testing.assert_allclose(np.linalg.norm(found.coefficients, axis=1), 1)
    np.testing.assert_allclose(found.matrices @ model.flash_white, found.coefficients, atol=1e-9)
    # without shadows only the outline of the pixels' cloud speaks, less plainly of three lamps
    limit = 0.3 if scene == "shadowed" else (0.8 if len(which) < 3 else 2.0)
    assert angles(found.coefficients, whites(model, true)).max() < limit
    assert not found.four_or_more
    assert not found.unexplained
    assert found.confidence > 0.9 if automatic else found.confidence == 1


@pytest.mark.parametrize("requested", [1, 2, 3])
def test_the_published_method_is_that_of_the_paper(
    exact: Exact, model: Model, warm_to_cool: Floats64, requested: Any
) -> None:
    reduced = reduce_pair(exact(warm_to_cool)[0])

    found = estimate_lamps(reduced, model, requested, "paper")

    published = lights_of_pair(reduced, model, requested)
    redness = published[:, 0] / published.sum(axis=1)
    np.testing.assert_allclose(found.coefficients, published[np.argsort(-redness)])
    np.testing.assert_allclose(found.matrices, model.lamp_matrix(found.coefficients))
    assert not found.deviations.terms.any()  # of which the paper knows nothing


def test_methods_count_alike(exact: Exact, model: Model, warm_to_cool: Floats64) -> None:
    reduced = reduce_pair(exact(warm_to_cool)[0])

    best = estimate_lamps(reduced, model, "auto", "best")
    paper = estimate_lamps(reduced, model, "auto", "paper")

    assert len(best) == len(paper) == 3
    assert best.confidence == paper.confidence


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_lamps_are_named_from_warm_to_cool(
    exact: Exact, model: Model, warm_to_cool: Floats64, order: tuple[int, ...]
) -> None:
    pair, _ = exact(warm_to_cool[list(order)])

    found = estimate_lamps(reduce_pair(pair), model, 3, "best")

    redness = found.coefficients[:, 0] / found.coefficients.sum(axis=1)
    assert (np.diff(redness) < 0).all()
    assert angles(found.coefficients, whites(model, warm_to_cool)).max() < 2


def test_matrices_are_those_of_the_lamps(
    exact: Exact, model: Model, warm_to_cool: Floats64
) -> None:
    pair, layers = exact(warm_to_cool[[0, 2]])
    part = pair.flash - pair.no_flash

    found = estimate_lamps(reduce_pair(pair), model, 2, "best")

    for matrix, layer in zip(found.matrices, layers, strict=True):
        lit = layer.sum(axis=2) > 0.01
        assert np.median(angles(part[lit] @ matrix.T, layer[lit])) < 1


@pytest.mark.parametrize("requested", [1, 2, 3])
def test_what_is_asked_for_is_given(
    exact: Exact, model: Model, warm_to_cool: Floats64, requested: Any
) -> None:
    pair, _ = exact(warm_to_cool[[0, 2]])

    found = estimate_lamps(reduce_pair(pair), model, requested, "best")

    assert len(found) == requested
    assert found.confidence == 1.0
    assert np.isfinite(found.coefficients).all()
    assert found.matrices.shape == (requested, 3, 3)
    assert found.lamp_confidence.shape == (requested,)
    assert ((found.lamp_confidence >= 0) & (found.lamp_confidence <= 1)).all()


def test_channels_are_weighed_by_their_light(
    exact: Exact, model: Model, warm_to_cool: Floats64
) -> None:
    pair, _ = exact(warm_to_cool[[0, 2]])
    reduced = reduce_pair(pair)

    found = estimate_lamps(reduced, model, 2, "best")

    mean = reduced.no_flash[reduced.usable].mean(axis=0)
    np.testing.assert_allclose(found.channel_weights * mean, 1, rtol=1e-4)


def test_invariants_are_unit_vectors_between_the_lamps(
    exact: Exact, model: Model, warm_to_cool: Floats64
) -> None:
    pair, _ = exact(warm_to_cool[[0, 2]])

    found = estimate_lamps(reduce_pair(pair), model, 2, "best")

    np.testing.assert_allclose(np.linalg.norm(found.invariants, axis=1), 1, rtol=1e-6)
    plane = np.cross(warm_to_cool[0], warm_to_cool[2])
    assert np.abs(found.invariants @ plane).max() < 0.01


def test_the_least_angle_is_that_of_similar_lamps(
    exact: Exact, model: Model, warm_to_cool: Floats64
) -> None:
    warm, _, cool = warm_to_cool
    pair, _ = exact(np.array([warm, 0.92 * warm + 0.08 * cool]))

    found = estimate_lamps(reduce_pair(pair), model, 2, "best")

    mixed = 0.92 * warm + 0.08 * cool
    true = np.degrees(np.arccos(warm @ mixed / np.linalg.norm(mixed)))
    assert found.least_angle_deg == pytest.approx(true, abs=0.4)
    assert found.least_sine == pytest.approx(np.sin(np.radians(found.least_angle_deg)))


def test_lamps_that_stand_out_less_are_less_sure(
    exact: Exact, model: Model, warm_to_cool: Floats64, pair_of: Callable[..., Any]
) -> None:
    warm, _, cool = warm_to_cool
    rng = np.random.default_rng(3)
    sureness = []
    for part in (1.0, 0.3, 0.1):
        clean, _ = exact(np.array([warm, (1 - part) * warm + part * cool]))
        noisy = clean.no_flash * (1 + rng.normal(0, 0.03, clean.no_flash.shape))
        reduced = reduce_pair(pair_of(noisy, clean.flash - clean.no_flash))
        sureness.append(estimate_lamps(reduced, model, 2, "best").lamp_confidence.min())

    assert sureness == sorted(sureness, reverse=True)
    assert sureness[0] > 0.8


def test_lamps_are_found_in_noise(
    exact: Exact, model: Model, warm_to_cool: Floats64, pair_of: Callable[..., Any]
) -> None:
    clean, _ = exact(warm_to_cool[[0, 2]])
    rng = np.random.default_rng(4)
    noisy = clean.no_flash * (1 + rng.normal(0, 0.02, clean.no_flash.shape))
    stray = rng.uniform(size=clean.unusable.shape) < 0.01
    noisy[stray] = rng.uniform(0, 0.5, (int(stray.sum()), 3))
    pair = pair_of(noisy, clean.flash - clean.no_flash)

    found = estimate_lamps(reduce_pair(pair), model, 2, "best")

    assert angles(found.coefficients, whites(model, warm_to_cool[[0, 2]])).max() < 3


def test_estimating_is_the_same_every_time(
    exact: Exact, model: Model, warm_to_cool: Floats64
) -> None:
    reduced = reduce_pair(exact(warm_to_cool)[0])

    once, again = (estimate_lamps(reduced, model, "auto", "best") for _ in range(2))

    np.testing.assert_array_equal(once.coefficients, again.coefficients)
    assert once.confidence == again.confidence


@pytest.mark.parametrize("usable", [0, 1, 199])
@pytest.mark.parametrize("requested", ["auto", 1, 2, 3])
def test_too_few_pixels_are_refused(
    exact: Exact, model: Model, warm_to_cool: Floats64, usable: int, requested: Any
) -> None:
    reduced = reduce_pair(exact(warm_to_cool[[0, 2]])[0])
    few = np.zeros(reduced.usable.size, bool)
    few[:usable] = True

    with pytest.raises(UnusablePairError, match=r"^Too few pixels show both lamps and flash"):
        estimate_lamps(
            replace(reduced, usable=few.reshape(reduced.usable.shape)),
            model,
            requested,
            "best",
        )


@pytest.mark.parametrize("requested", ["auto", 1, 2, 3])
def test_a_pair_of_one_even_colour_is_one_lamp_or_what_was_asked(
    pair_of: Callable[..., Any], model: Model, warm_to_cool: Floats64, requested: Any
) -> None:
    part = np.tile(np.array([0.3, 0.5, 0.4]), (40, 60, 1))
    pair = pair_of(part @ model.lamp_matrix(0.5 * warm_to_cool[0]).T, part)

    found = estimate_lamps(reduce_pair(pair), model, requested, "best")

    assert len(found) == (1 if requested == "auto" else requested)
    white = whites(model, warm_to_cool[:1]).repeat(len(found), axis=0)
    assert angles(found.coefficients, white).max() < 0.1


def test_matrices_that_point_the_other_way_are_turned(
    shadowed: Shadowed, model: Model, warm_to_cool: Floats64, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chromaticities do not tell T from −T."""
    true = model.lamp_matrix(warm_to_cool[[0, 2]])
    monkeypatch.setattr(lamps, "fit_matrices", lambda *_: Fit(true * [[[1]], [[-1]]], 0.0))

    found = estimate_lamps(reduce_pair(shadowed(warm_to_cool[[0, 2]])), model, 2, "best")

    assert angles(found.coefficients, whites(model, warm_to_cool[[0, 2]])).max() < 1e-4
    np.testing.assert_allclose(found.matrices @ model.flash_white, found.coefficients)


def test_lamps_are_moved_by_pools_before_they_are_followed_outwards(
    shadowed: Shadowed, model: Model, warm_to_cool: Floats64, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved = Fit(model.lamp_matrix(warm_to_cool[[0, 1]]), 0.0)
    monkeypatch.setattr(lamps, "fit_pools", lambda *_: moved)
    monkeypatch.setattr(lamps, "follow_outwards", lambda *given: given[-1])

    found = estimate_lamps(reduce_pair(shadowed(warm_to_cool[[0, 2]])), model, 2, "best")

    assert angles(found.coefficients, whites(model, warm_to_cool[[0, 1]])).max() < 1e-4


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("turned", [1, -1])
def test_two_other_lamps_that_a_search_came_to_are_rivals(
    shadowed: Shadowed,
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    swapped: bool,
    turned: int,
) -> None:
    """However they are ordered: one is the same, the other lies between those found, or back."""
    colours = warm_to_cool[[0, 2]], warm_to_cool[[1, 0]]
    wide, narrow = (model.lamp_matrix(one) for one in (colours[::-1] if swapped else colours))
    fit = Fit(wide, 0.0, (turned * narrow,))
    for name in ("first_fit", "fit_matrices"):
        monkeypatch.setattr(lamps, name, lambda *_: fit)
    monkeypatch.setattr(lamps, "follow_outwards", lambda *given: given[-1])

    found = estimate_lamps(reduce_pair(shadowed(warm_to_cool[[0, 2]])), model, 2, "best")

    expected = float(angles(*whites(model, warm_to_cool[[1, 2]])))
    assert found.rival_deg == pytest.approx(expected, abs=1e-6)
    bent = replace(shadowed(warm_to_cool[[0, 2]]), rendered=True)
    assert estimate_lamps(reduce_pair(bent), model, 2, "best").rival_deg == 0


@pytest.mark.parametrize("which", [[0, 2], [0, 1, 2]])
def test_lamps_found_in_two_ways_have_no_rivals(
    shadowed: Shadowed, model: Model, warm_to_cool: Floats64, which: list[int]
) -> None:
    reduced = reduce_pair(shadowed(warm_to_cool[which]))

    assert estimate_lamps(reduced, model, "auto", "best").rival_deg < 0.1
    assert estimate_lamps(reduced, model, "auto", "paper").rival_deg == 0.0


@pytest.mark.parametrize(("requested", "confidence"), [("auto", 0.5), (1, 1.0)])
def test_lamps_that_do_not_explain_the_photograph_are_half_certain(
    shadowed: Shadowed,
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    requested: Literal["auto", 1],
    confidence: float,
) -> None:
    monkeypatch.setattr(lamps, "left_over", lambda *_: 0.09)
    pair = shadowed(warm_to_cool[:1])

    found = estimate_lamps(reduce_pair(pair), model, requested, "best")

    assert found.confidence == confidence
    assert found.left_over == 0.09
    assert found.unexplained


def test_signs_of_four_lamps_are_told(
    shadowed: Shadowed, model: Model, warm_to_cool: Floats64
) -> None:
    four = np.vstack([warm_to_cool, [[0.69, 0.3, 0.65]]])
    reduced = reduce_pair(shadowed(four))

    given: tuple[Literal["auto", 3], ...] = ("auto", 3)
    for requested in given:
        found = estimate_lamps(reduced, model, requested, "best")

        assert len(found) == 3
        assert found.four_or_more
        assert found.confidence == (0.3 if requested == "auto" else 1.0)

        published = estimate_lamps(reduced, model, requested, "paper")

        # the published method says nothing of how many there are
        assert published.four_or_more is (requested == "auto")


@pytest.mark.parametrize(("requested", "more"), [(1, False), (2, False), (3, True)])
def test_fewer_lamps_that_were_asked_for_are_no_sign_of_a_fourth(
    exact: Exact,
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    requested: Literal[1, 2, 3],
    more: bool,
) -> None:
    asked = model.lamp_matrix(warm_to_cool[:requested])
    monkeypatch.setattr(lamps, "fit_matrices", lambda *_: Fit(asked, 0.0))
    monkeypatch.setattr(lamps, "signs_of_fourth", lambda *_: True)

    found = estimate_lamps(reduce_pair(exact(warm_to_cool)[0]), model, requested, "best")

    assert found.four_or_more is more


def test_a_fourth_is_told_by_lamps_of_pools_before_they_are_followed_outwards(
    exact: Exact, model: Model, warm_to_cool: Floats64, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Followed outwards they leave less, as if there were no fourth."""
    usual = model.lamp_matrix(warm_to_cool)
    moved, outwards = np.roll(usual, 1, axis=1), np.roll(usual, 1, axis=2)
    monkeypatch.setattr(lamps, "fit_matrices", lambda *_: Fit(usual, 0.0))
    monkeypatch.setattr(lamps, "fit_pools", lambda *_: Fit(moved, 0.0))
    monkeypatch.setattr(lamps, "follow_outwards", lambda *_: Fit(outwards, 0.0))
    monkeypatch.setattr(lamps, "signs_of_fourth", lambda _, found: np.array_equal(found, moved))

    found = estimate_lamps(reduce_pair(exact(warm_to_cool)[0]), model, 3, "best")

    assert found.four_or_more
    assert angles(found.coefficients, whites(model, warm_to_cool)).min() > 1  # the followed ones


@pytest.mark.parametrize("scene", ["shadowed", "smooth"])
def test_one_lamp_for_two_does_not_explain_the_photograph(
    exact: Exact, shadowed: Shadowed, model: Model, warm_to_cool: Floats64, scene: str
) -> None:
    two = warm_to_cool[[0, 2]]
    pair = shadowed(two) if scene == "shadowed" else exact(two)[0]

    found = estimate_lamps(reduce_pair(pair), model, 1, "best")

    assert found.unexplained
    assert found.left_over > 0.08


def test_one_lamp_is_like_no_other(exact: Exact, model: Model, warm_to_cool: Floats64) -> None:
    found = estimate_lamps(reduce_pair(exact(warm_to_cool[:1])[0]), model, 1, "best")

    assert found.least_angle_deg == 90.0
    assert found.least_sine == 1.0


def test_edges_tell_which_lamp_casts_a_shadow(
    shadowed: Shadowed, exact: Exact, model: Model, warm_to_cool: Floats64
) -> None:
    two = warm_to_cool[[0, 2]]

    with_shadows = estimate_lamps(reduce_pair(shadowed(two)), model, 2, "best")
    without = estimate_lamps(reduce_pair(exact(two)[0]), model, 2, "best")

    assert with_shadows.alone.shape == (2,)
    assert (with_shadows.alone > 0.01).all()
    assert (without.alone < 0.002).all()
