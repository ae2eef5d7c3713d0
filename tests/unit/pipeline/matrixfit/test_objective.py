from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.light.model import Model
from pipeline.matrixfit.chromaticities import Chromaticities, nothing
from pipeline.matrixfit.evidence import Evidence
from pipeline.matrixfit.known import nothing_known
from pipeline.matrixfit.objective import (
    Shape,
    Term,
    Whitened,
    alone_term,
    make_terms,
    most_mirrored,
    posterior,
    without_mirrors,
)
from pipeline.vectors import unit

LIGHTS = np.array([[0.8, 0.5, 0.2], [0.4, 0.6, 0.7], [0.4, 0.8, 0.3]])
PURE = 0.02
EMPTY = nothing()


def drawn(
    model: Model, count: int, seed: int, lamps: int = 2, noise: float = 0.004
) -> Chromaticities:
    """Mixtures of lamps on surfaces of many colours, with noise."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.2, 1.0, (count, 3))
    x /= x.sum(axis=1, keepdims=True)
    share = rng.uniform(0, 1, (lamps, count, 1))
    light = (share * np.einsum("jkl,nl->jnk", model.lamp_matrix(LIGHTS[:lamps]), x)).sum(axis=0)
    u = light[:, :2] / light.sum(axis=1, keepdims=True) + rng.normal(0, noise, (count, 2))
    covariance = np.tile([noise**2, 0.3 * noise**2, noise**2], (count, 1))
    return Chromaticities(x, u, covariance, np.full(count, 400.0 / count))


WHITE = np.array([0.6, 1.0, 0.9])


def seen(
    pixels: Chromaticities = EMPTY,
    differences: Chromaticities = EMPTY,
    terminators: Chromaticities = EMPTY,
    pools: Chromaticities = EMPTY,
) -> Evidence:
    return Evidence(pixels, differences, terminators, pools, 0.1, 0.0)


def open_field(matrices: Floats64) -> tuple[float, Floats64]:
    """No place where lamps may not be."""
    return 0.0, np.zeros_like(matrices)


def pure(data: Chromaticities, matrix: Floats64) -> Chromaticities:
    """The same surfaces, lit by one lamp."""
    light = data.x @ matrix.T
    u = light[:, :2] / light.sum(axis=1, keepdims=True)
    return Chromaticities(data.x, u, data.covariance, data.weight)


@pytest.mark.parametrize("lamps", [1, 2, 3])
@pytest.mark.parametrize("outline", [False, True])
@pytest.mark.parametrize("pinned", [0, 1])
def test_the_gradient_is_that_of_differences(
    model: Model, lamps: int, outline: bool, pinned: int
) -> None:
    evidence = seen(*(drawn(model, n, i, lamps) for i, n in enumerate((60, 40, 30, 20), 1)))
    made = make_terms(evidence, lamps, outline, PURE, WHITE)
    terms = [Whitened(term, 0.01) for term in made]
    weights = [term.weights for term in made]
    shown = pure(drawn(model, 30, 5), model.lamp_matrix(LIGHTS[2]))
    alone = [Whitened(alone_term(shown), 0.01)] * pinned
    white = model.lamp_matrix(LIGHTS[:1] + 0.01) @ model.flash_white
    fence = replace(nothing_known(model.flash_white), forbidden=unit(white)).fence
    rng = np.random.default_rng(0)
    theta = model.prior.coordinates(model.lamp_matrix(LIGHTS[:lamps]))
    theta = theta + rng.normal(0, 0.02, theta.shape)

    _, gradient = posterior(theta, model.prior, terms, weights, alone, fence)

    for place in np.ndindex(theta.shape):
        step = np.zeros_like(theta)
        step[place] = 1e-6
        up, down = (
            posterior(theta + s * step, model.prior, terms, weights, alone, fence)[0]
            for s in (1, -1)
        )
        assert gradient[place] == pytest.approx((up - down) / 2e-6, rel=1e-3, abs=1e-2)


def test_without_data_the_prior_is_left(model: Model) -> None:
    terms = [Whitened(term, 0.01) for term in make_terms(seen(), 2, False, PURE, WHITE)]
    weights = [term.term.weights for term in terms]
    theta = np.random.default_rng(0).normal(0, 0.3, (2, 9))

    value, gradient = posterior(theta, model.prior, terms, weights, [], open_field)

    expected, slope = model.prior.penalty(theta)
    assert value == expected
    np.testing.assert_array_equal(gradient, slope)


def test_the_true_lamps_explain_the_data_best(model: Model) -> None:
    made = make_terms(seen(drawn(model, 300, 3), drawn(model, 9, 4)), 2, False, PURE, WHITE)
    terms = [Whitened(term, 0.005) for term in made]
    weights = [term.weights for term in made]

    def value(lights: Floats64) -> float:
        theta = model.prior.coordinates(model.lamp_matrix(lights))
        return posterior(theta, model.prior, terms, weights, [], open_field)[0]

    for wrong in (
        [[0.8, 0.5, 0.3], LIGHTS[1]],
        [LIGHTS[0], [0.5, 0.6, 0.6]],
        [[0.9, 0.4, 0.1], LIGHTS[1]],
    ):
        assert value(LIGHTS[:2]) < value(np.array(wrong))


def test_what_a_lamp_shows_alone_counts_for_that_lamp(model: Model) -> None:
    theta = model.prior.coordinates(model.lamp_matrix(LIGHTS[:2]))
    shown = pure(drawn(model, 30, 5), model.lamp_matrix(LIGHTS[0]))
    alone = [Whitened(alone_term(shown), 0.01)]

    right, _ = posterior(theta, model.prior, [], [], alone, open_field)
    swapped, _ = posterior(theta[::-1], model.prior, [], [], alone, open_field)

    # a corner of density 0.98 / (2π 0.01²) at the datum, and outliers of 1.5 everywhere
    corner = 0.98 / (2 * np.pi * (1e-4 + shown.covariance[:, 0].mean())) + 0.03
    assert right == pytest.approx(-shown.weight.sum() * np.log(corner), rel=0.02)
    assert swapped - right > 5 * shown.weight.sum()


def test_whitened_data_are_isotropic_and_keep_their_areas() -> None:
    """A normal density is the same whitened: over its peak, 1 / (2π √det covariance)."""
    covariance = np.array([[9e-6, 5e-6], [5e-6, 4e-6]])
    floor = np.eye(2) * 0.002**2
    full = covariance + floor
    offset = np.array([0.004, -0.001])
    grey = np.full((1, 3), 1 / 3)
    data = Chromaticities(grey, 1 / 3 + offset[None], np.array([[9e-6, 5e-6, 4e-6]]), np.ones(1))
    term = Term(data, Shape(False, 0.0, 1.5, 1.0), np.array([1.0, 0.0]), None)

    value, _, _ = Whitened(term, 0.002).value(np.eye(3)[None], term.weights)

    expected = 0.5 * offset @ np.linalg.solve(full, offset)
    expected += np.log(2 * np.pi * np.sqrt(np.linalg.det(full)))
    assert value == pytest.approx(expected)


def test_differences_are_spread_more_widely_at_a_level() -> None:
    grey = np.full((1, 3), 1 / 3)
    data = Chromaticities(grey, grey[:, :2], np.zeros((1, 3)), np.ones(1))
    term = Term(data, Shape(False, 0.0, 1.5, 1.5), np.array([1.0, 0.0]), None)

    value, _, _ = Whitened(term, 0.002).value(np.eye(3)[None], term.weights)

    assert value == pytest.approx(np.log(2 * np.pi * 0.003**2))


def test_reweighting_finds_how_much_is_pure(model: Model) -> None:
    """Differences of which all lie at the first corner."""
    matrices = model.lamp_matrix(LIGHTS[:2])
    data = pure(drawn(model, 400, 6), matrices[0])
    term = Whitened(make_terms(seen(differences=data), 2, False, PURE, WHITE)[1], 0.004)

    found = term.reweighted(matrices, term.term.weights)

    assert found.sum() == pytest.approx(1)
    assert found[0] > 0.8
    assert (found > 0).all()
    assert found[1] < term.term.weights[1]


def test_borders_of_highlights_are_told_from_those_of_shadows(model: Model) -> None:
    """Differences that all have the first lamp's own colour, on surfaces of many."""
    matrices = model.lamp_matrix(LIGHTS[:2])
    own = matrices[0] @ model.flash_white
    data = drawn(model, 400, 6)
    data = replace(data, u=np.tile(own[:2] / own.sum(), (400, 1)))
    made = make_terms(seen(differences=data), 2, False, PURE, model.flash_white)[1]
    term = Whitened(made, 0.004)
    matt = without_mirrors(made)

    found = term.reweighted(matrices, made.weights)

    assert found[3] > 0.7
    assert found[4] < made.weights[4]
    assert most_mirrored(made, matrices, 0.004) == found[3:5].max()
    assert term.value(matrices, found)[0] < Whitened(matt, 0.004).value(matrices, matt.weights)[0]


def test_without_mirrors_weights_keep_their_proportions() -> None:
    made = make_terms(seen(), 2, False, PURE, WHITE)[1]

    matt = without_mirrors(made)

    np.testing.assert_allclose(matt.weights, made.weights[[0, 1, 2, 5]] / 0.85)
    np.testing.assert_array_equal(matt.mirrored, np.zeros(3))
    assert without_mirrors(matt) is matt


def test_matt_differences_are_mirrored_by_none(model: Model) -> None:
    matrices = model.lamp_matrix(LIGHTS[:2])
    data = pure(drawn(model, 400, 6), matrices[0])
    made = make_terms(seen(differences=data), 2, False, PURE, model.flash_white)[1]

    assert most_mirrored(made, matrices, 0.004) < 0.1
    assert most_mirrored(without_mirrors(made), matrices, 0.004) == 0.0


def test_a_pseudo_count_keeps_weights_near_where_they_began(model: Model) -> None:
    matrices = model.lamp_matrix(LIGHTS[:2])
    data = pure(drawn(model, 400, 6), matrices[0])
    made = make_terms(seen(differences=data), 2, False, PURE, WHITE)[1]
    firm = Term(made.data, made.shape, made.weights, 1e9)

    found = Whitened(firm, 0.004).reweighted(matrices, made.weights)

    np.testing.assert_allclose(found, made.weights, atol=1e-6)


@pytest.mark.parametrize("outline", [False, True])
def test_weights_of_pixels_stay(model: Model, outline: bool) -> None:
    matrices = model.lamp_matrix(LIGHTS[:2])
    term = make_terms(seen(pure(drawn(model, 400, 6), matrices[0])), 2, outline, PURE, WHITE)[0]

    found = Whitened(term, 0.004).reweighted(matrices, term.weights)

    np.testing.assert_array_equal(found, term.weights)


def test_no_differences_leave_their_weights(model: Model) -> None:
    term = make_terms(seen(), 2, False, PURE, WHITE)[1]

    found = Whitened(term, 0.004).reweighted(model.lamp_matrix(LIGHTS[:2]), term.weights)

    np.testing.assert_array_equal(found, term.weights)


@pytest.mark.parametrize("lamps", [1, 2, 3])
@pytest.mark.parametrize("outline", [False, True])
def test_weights_begin_as_shares_of_all_components(lamps: int, outline: bool) -> None:
    terms = make_terms(seen(), lamps, outline, PURE, WHITE)

    assert len(terms) == 3
    for term in terms:
        interior = lamps == 3 and term.shape.interior
        mirrors = 2 * bool(term.mirrored.any())
        assert mirrors == (2 if lamps == 2 and term is terms[1] and not outline else 0)
        assert len(term.weights) == {1: 2, 2: 4, 3: 7}[lamps] + interior + mirrors
        assert term.weights.sum() == pytest.approx(1)


@pytest.mark.parametrize("lamps", [2, 3])
def test_the_share_of_pure_pixels_is_that_of_every_lamp(lamps: int) -> None:
    """Differences have shares of their own."""
    pixels, differences, _ = make_terms(seen(), lamps, False, 0.03, WHITE)

    np.testing.assert_allclose(pixels.weights[:lamps], 0.03)
    assert pixels.weights.sum() == pytest.approx(1)
    np.testing.assert_array_equal(
        differences.weights, make_terms(seen(), lamps, False, 0.01, WHITE)[1].weights
    )


@pytest.mark.parametrize(("lamps", "coves"), [(1, 0.0), (2, 0.0), (3, 0.15)])
def test_beside_edges_some_pools_of_three_lamps_have_the_light_of_all(
    lamps: int, coves: float
) -> None:
    term = make_terms(seen(), lamps, False, PURE, WHITE)[2]
    plain = make_terms(seen(), lamps, True, PURE, WHITE)[2]

    assert term.shape.interior is (coves > 0)
    assert not plain.shape.interior
    pairs = lamps * (lamps + 1) // 2
    np.testing.assert_array_equal(term.weights[:pairs], plain.weights[:pairs])
    assert plain.weights[-1] - term.weights[-1] == pytest.approx(coves)
    assert term.weights[pairs:-1].sum() == coves


def test_terminators_show_lamps_alone(model: Model) -> None:
    """They are taken for corners, not for mixtures."""
    matrices = model.lamp_matrix(LIGHTS[:2])
    mixed, first = drawn(model, 400, 6), pure(drawn(model, 400, 6), matrices[0])
    costs = []
    for data in (mixed, first):
        term = Whitened(make_terms(seen(terminators=data), 2, True, PURE, WHITE)[1], 0.004)
        costs.append(term.value(matrices, term.term.weights)[0])

    # a corner of density 0.425 / (2π √det), and outliers of 6
    covariance = 0.006**2 * np.eye(2) + 0.004**2 * np.array([[1, 0.3], [0.3, 1]])
    peak = 0.425 / (2 * np.pi * np.sqrt(np.linalg.det(covariance)))
    assert costs[1] == pytest.approx(-400 * np.log(peak), rel=0.01)
    assert costs[0] > costs[1] + 800
