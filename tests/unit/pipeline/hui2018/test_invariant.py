from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.hui2018.invariant import flash_tensor, light_coefficients
from pipeline.light.model import Model


@pytest.fixture(scope="module")
def tensor() -> Floats64:
    """Any model E[k, i, j] that is well away from singular."""
    rng = np.random.default_rng(11)
    return np.asarray(rng.uniform(0.05, 0.4, (3, 3, 3)) + np.eye(3)[:, :, None])


FLASH = np.array([0.6, 1.0, 0.8])


def test_beta_is_recovered_exactly_in_the_model(tensor: Floats64) -> None:
    rng = np.random.default_rng(5)
    alpha, beta = rng.uniform(0.1, 1, (200, 3)), rng.uniform(0, 2, (200, 3))
    no_flash = np.einsum("kij,pi,pj->pk", tensor, alpha, beta)
    flash = np.einsum("kij,pi,j->pk", tensor, alpha, FLASH)

    found = light_coefficients(no_flash, flash, flash_tensor(tensor, FLASH))

    np.testing.assert_allclose(found, beta, rtol=1e-6, atol=1e-8)


def test_beta_does_not_depend_on_the_surface(tensor: Floats64) -> None:
    rng = np.random.default_rng(6)
    alpha, beta = rng.uniform(0.1, 1, (100, 3)), np.array([0.9, 0.3, 0.5])
    no_flash = np.einsum("kij,pi,j->pk", tensor, alpha, beta)
    flash = np.einsum("kij,pi,j->pk", tensor, alpha, FLASH)

    found = light_coefficients(no_flash, flash, flash_tensor(tensor, FLASH))

    np.testing.assert_allclose(found, np.tile(beta, (100, 1)), rtol=1e-7)


def test_the_flash_itself_is_one(tensor: Floats64) -> None:
    d = flash_tensor(tensor, FLASH)

    np.testing.assert_allclose(np.einsum("klj,j->kl", d, FLASH), np.eye(3), atol=1e-12)


def test_a_lamp_as_bright_again_doubles_beta(model: Model, surfaces: Floats64) -> None:
    lit = surfaces @ model.lamp_matrix(np.array([0.7, 0.6, 0.3])).T

    once = light_coefficients(lit, surfaces, model.tensor)
    twice = light_coefficients(2 * lit, surfaces, model.tensor)

    np.testing.assert_allclose(once, np.tile([0.7, 0.6, 0.3], (len(surfaces), 1)), atol=1e-9)
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-12)


def test_beta_does_not_depend_on_the_brightness_of_the_surface(
    model: Model, surfaces: Floats64
) -> None:
    lit = surfaces @ model.lamp_matrix(np.array([0.2, 0.6, 0.7])).T

    found = light_coefficients(1e-6 * lit, 1e-6 * surfaces, model.tensor)

    np.testing.assert_allclose(found, light_coefficients(lit, surfaces, model.tensor), rtol=1e-9)


def test_another_camera_sees_the_same_light_through_its_own_tensor(tensor: Floats64) -> None:
    rng = np.random.default_rng(8)
    other = rng.uniform(0, 1, (3, 3, 3))
    alpha, beta = rng.uniform(0.1, 1, (50, 3)), np.array([0.3, 0.5, 0.9])
    flash = np.einsum("kij,pi,j->pk", tensor, alpha, FLASH)

    d = flash_tensor(tensor, FLASH, seen_by=other)

    seen = np.einsum("klj,pl,j->pk", d, flash, beta)
    np.testing.assert_allclose(seen, np.einsum("kij,pi,j->pk", other, alpha, beta), rtol=1e-9)


def test_a_flash_of_no_light_has_no_tensor(tensor: Floats64) -> None:
    with pytest.raises(np.linalg.LinAlgError):
        flash_tensor(tensor, np.zeros(3))


def test_pixels_without_flash_light_give_zero(model: Model) -> None:
    found = light_coefficients(np.full((4, 5, 3), 0.3), np.zeros((4, 5, 3)), model.tensor)

    assert found.shape == (4, 5, 3)
    assert not found.any()


def test_a_system_that_is_singular_gives_zero() -> None:
    same = np.repeat(np.eye(3)[:, :, None], 3, axis=2)

    found = light_coefficients(np.array([[0.2, 0.3, 0.4]]), np.array([[0.5, 0.5, 0.5]]), same)

    np.testing.assert_array_equal(found, np.zeros((1, 3)))


@pytest.mark.parametrize("value", [np.float32(-0.01), np.float32(1e-12), np.float32(1e4)])
def test_odd_pixels_stay_finite(model: Model, value: np.float32) -> None:
    flash = np.array([[value, 0.0, 0.0], [value, value, value]], dtype=np.float32)

    found = light_coefficients(np.full((2, 3), 0.1, np.float32), flash, model.tensor)

    assert np.isfinite(found).all()
