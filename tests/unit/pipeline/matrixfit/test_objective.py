from __future__ import annotations

import numpy as np
import pytest

from pipeline.matrixfit.evidence import Data
from pipeline.matrixfit.objective import Whitened, make_terms, posterior
from pipeline.model import Model

LIGHTS = np.array([[0.8, 0.5, 0.2], [0.4, 0.6, 0.7]])


def drawn(model: Model, count: int, seed: int, noise: float = 0.004) -> Data:
    """Mixtures of two lamps on surfaces of many colours, with noise."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.2, 1.0, (count, 3))
    x /= x.sum(axis=1, keepdims=True)
    share = rng.uniform(0, 1, (2, count, 1))
    light = (share * np.einsum("jkl,nl->jnk", model.lamp_matrix(LIGHTS), x)).sum(axis=0)
    u = light[:, :2] / light.sum(axis=1, keepdims=True) + rng.normal(0, noise, (count, 2))
    covariance = np.tile([noise**2, 0.3 * noise**2, noise**2], (count, 1))
    return Data(x, u, covariance, np.full(count, 400.0 / count))


def test_the_gradient_is_that_of_differences(model: Model) -> None:
    terms = [Whitened(t, 0.01) for t in make_terms(drawn(model, 60, 1), drawn(model, 40, 2), False)]
    weights = [term.term.weights for term in terms]
    rng = np.random.default_rng(0)
    theta = model.prior.coordinates(model.lamp_matrix(LIGHTS)) + rng.normal(0, 0.02, (2, 9))

    _, gradient = posterior(theta, model.prior, terms, weights)

    for place in np.ndindex(2, 9):
        step = np.zeros((2, 9))
        step[place] = 1e-6
        up, down = (posterior(theta + s * step, model.prior, terms, weights)[0] for s in (1, -1))
        slope = (up - down) / 2e-6
        assert gradient[place] == pytest.approx(slope, rel=1e-3, abs=1e-2)


def test_the_true_lamps_explain_the_data_best(model: Model) -> None:
    terms = [
        Whitened(t, 0.005) for t in make_terms(drawn(model, 300, 3), drawn(model, 9, 4), False)
    ]
    weights = [term.term.weights for term in terms]

    def value(lights: np.ndarray) -> float:
        theta = model.prior.coordinates(model.lamp_matrix(lights))
        return posterior(theta, model.prior, terms, weights)[0]

    for wrong in (
        [[0.8, 0.5, 0.3], LIGHTS[1]],
        [LIGHTS[0], [0.5, 0.6, 0.6]],
        [[0.9, 0.4, 0.1], LIGHTS[1]],
    ):
        assert value(LIGHTS) < value(np.array(wrong))


def test_whitened_data_have_noise_alike_in_every_direction() -> None:
    noise = np.random.default_rng(5).multivariate_normal([0, 0], [[9e-6, 5e-6], [5e-6, 4e-6]], 4000)
    data = Data(
        np.full((4000, 3), 1 / 3),
        0.3 + noise,
        np.tile([9e-6, 5e-6, 4e-6], (4000, 1)),
        np.ones(4000),
    )

    white = Whitened(make_terms(data, data, True)[0], 1e-9)

    covariance = np.cov(white.u.T)
    np.testing.assert_allclose(covariance, np.eye(2) * white.sigma[0] ** 2, atol=2e-7)


def test_reweighting_finds_how_much_is_pure(model: Model) -> None:
    """Data of which most lie at the first corner."""
    mixed = drawn(model, 400, 6)
    matrices = model.lamp_matrix(LIGHTS)
    light = mixed.x @ matrices[0].T
    pure = Data(
        mixed.x, light[:, :2] / light.sum(axis=1, keepdims=True), mixed.covariance, mixed.weight
    )
    term = Whitened(make_terms(pure, pure, False)[0], 0.004)

    found = term.reweighted(matrices, term.term.weights)

    assert found.sum() == pytest.approx(1)
    assert found[0] > 0.6
    assert 0.005 <= found[-1] <= 0.03
