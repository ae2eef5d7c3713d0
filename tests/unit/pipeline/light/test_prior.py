from __future__ import annotations

import numpy as np
import pytest

from pipeline.light.model import Model
from pipeline.light.prior import MatrixPrior, learn_prior


@pytest.fixture
def prior(model: Model) -> MatrixPrior:
    return model.prior


def test_the_basis_is_orthonormal_and_begins_with_the_model(
    prior: MatrixPrior, model: Model
) -> None:
    np.testing.assert_allclose(prior.basis.T @ prior.basis, np.eye(9), atol=1e-9)
    for light in range(3):
        inside = prior.coordinates(model.tensor[None, :, :, light])[0]
        np.testing.assert_allclose(inside[3:], 0, atol=1e-6)


def test_matrices_and_coordinates_invert_each_other(prior: MatrixPrior) -> None:
    drawn = np.random.default_rng(0).normal(size=(2, 3, 3))
    drawn /= np.linalg.norm(drawn, axis=(1, 2), keepdims=True)

    np.testing.assert_allclose(prior.matrices(prior.coordinates(drawn)), drawn, atol=1e-9)


def test_the_penalty_has_its_gradient(prior: MatrixPrior) -> None:
    theta = np.random.default_rng(1).normal(size=(2, 9)) * 0.4
    _, gradient = prior.penalty(theta)

    for place in np.ndindex(2, 9):
        step = np.zeros((2, 9))
        step[place] = 1e-6
        slope = (prior.penalty(theta + step)[0] - prior.penalty(theta - step)[0]) / 2e-6
        assert gradient[place] == pytest.approx(slope, rel=1e-4, abs=1e-4)


def test_the_penalty_counts_deviations_and_what_length_is_not_one() -> None:
    """½ (2² + 3²) of a lamp 2 and 3 deviations off, 50 (|θ|² − 1)² of it and of a long one."""
    prior = MatrixPrior(np.eye(9), np.array([0.5, 0.25, 1.0, 1.0, 1.0, 1.0]))
    unlikely = [0.0, 0.0, 0.0, 1.0, -0.75, 0.0, 0.0, 0.0, 0.0]
    usual = [0.6, 0.0, 0.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    long = [1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]

    value, _ = prior.penalty(np.array([unlikely, usual, long]))

    assert value == pytest.approx(6.5 + 50 * (0.5625**2 + 1.25**2))


def test_lights_of_the_model_cost_nothing(prior: MatrixPrior, model: Model) -> None:
    theta = prior.coordinates(model.lamp_matrix(np.array([[0.8, 0.5, 0.2], [0.4, 0.6, 0.7]])))

    assert prior.penalty(theta)[0] == pytest.approx(0, abs=1e-9)


def test_what_lamps_do_costs_less_than_what_they_do_not() -> None:
    """Lamps that leave the model in one direction only make that direction cheap."""
    tensor = np.stack([np.diag(row) for row in np.eye(3)], axis=2)
    away = np.zeros((3, 3))
    away[0, 1] = 1.0
    lamps = np.stack([np.diag([1.0, 0.8, 0.6]) + share * away for share in (-0.5, 0.2, 0.4)])

    prior = learn_prior(tensor, lamps)

    other = np.zeros((3, 3))
    other[2, 0] = 1.0
    base = np.diag([1.0, 0.8, 0.6])
    known, unknown = (
        prior.penalty(prior.coordinates((base + 0.2 * one)[None]))[0] for one in (away, other)
    )
    assert known < 0.1 * unknown
    # a quarter of how far the lamps of length one leave the model, and of 0.02 where none does
    left = [share / np.sqrt(2 + share**2) for share in (-0.5, 0.2, 0.4)]
    expected = [0.25 * np.sqrt(np.mean(np.square(left))), *[0.005] * 5]
    np.testing.assert_allclose(prior.deviations, expected)
