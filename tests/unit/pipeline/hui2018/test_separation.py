from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.hui2018.separation import published_layers
from pipeline.images.frames import Image
from pipeline.light.model import Model


def of_pair(pair: Any) -> tuple[Image, Image]:
    """The no-flash photograph and the flash part."""
    return pair.no_flash, pair.flash - pair.no_flash


@pytest.mark.parametrize("count", [1, 2, 3])
def test_layers_are_exact_in_the_model(
    model: Model,
    exact: Callable[..., tuple[Any, Floats64]],
    warm_to_cool: Floats64,
    count: int,
) -> None:
    pair, layers = exact(warm_to_cool[:count])

    found = published_layers(*of_pair(pair), warm_to_cool[:count], model.tensor, model.published)

    assert found.dtype == np.float32
    np.testing.assert_allclose(found, layers, atol=2e-4 * layers.max())


def test_layers_are_equation_3(
    model: Model, exact: Callable[..., tuple[Any, Floats64]], warm_to_cool: Floats64
) -> None:
    """‖β‖ z_j Σ_l b_jl D_l I_f, written out for one pixel with shares found by hand."""
    _, layers = exact(warm_to_cool[[0, 2]])
    coefficients = warm_to_cool[[0, 2]]
    flash = np.array([[[0.3, 0.5, 0.4]]])
    matrices = model.lamp_matrix(coefficients)
    mixed = 0.6 * coefficients[0] + 0.9 * coefficients[1]
    no_flash = np.einsum("klj,j,hwl->hwk", model.tensor, mixed, flash)

    found = published_layers(no_flash, flash, coefficients, model.tensor, model.published)

    assert len(found) == len(layers)
    np.testing.assert_allclose(found[0, 0, 0], 0.6 * matrices[0] @ flash[0, 0], rtol=1e-4)
    np.testing.assert_allclose(found[1, 0, 0], 0.9 * matrices[1] @ flash[0, 0], rtol=1e-4)


def test_light_outside_the_cone_leaves_something_over(model: Model, warm_to_cool: Floats64) -> None:
    flash = np.full((1, 1, 3), 0.5)
    no_flash = flash @ model.lamp_matrix(warm_to_cool[1]).T

    found = published_layers(no_flash, flash, warm_to_cool[[0, 2]], model.tensor, model.published)

    assert np.abs(found.sum(axis=0) - no_flash).max() > 0.02


def test_light_outside_the_cone_goes_to_the_nearest_light_in_the_published_coordinates(
    model: Model,
) -> None:
    """By hand: of lights (1, 0, 0) and (0, 1, 0), Γ = (0.6, −0.64, 0.48) is nearest to 0.6 of the
    first, and ‖β‖ is that of the published coordinates."""
    back = np.linalg.inv(model.published)
    lights = np.array([[1.0, 0, 0], [0, 1, 0]]) @ back.T
    flash = np.array([[[0.3, 0.5, 0.4]]])
    beta = 2.0 * np.array([0.6, -0.64, 0.48])
    no_flash = np.einsum("klj,j,hwl->hwk", model.tensor, back @ beta, flash)

    found = published_layers(no_flash, flash, lights, model.tensor, model.published)

    expected = 2.0 * 0.6 * model.lamp_matrix(lights[0]) @ flash[0, 0]
    np.testing.assert_allclose(found[0, 0, 0], expected, rtol=1e-5)
    assert not found[1].any()


def test_the_length_of_the_coefficients_does_not_matter(
    model: Model, exact: Callable[..., tuple[Any, Floats64]], warm_to_cool: Floats64
) -> None:
    pair = of_pair(exact(warm_to_cool)[0])
    lengths = np.array([[0.1], [1.0], [30.0]])

    one = published_layers(*pair, warm_to_cool, model.tensor, model.published)
    other = published_layers(*pair, lengths * warm_to_cool, model.tensor, model.published)

    np.testing.assert_allclose(other, one, atol=1e-6)


def test_pixels_without_flash_light_hold_no_layer(model: Model, warm_to_cool: Floats64) -> None:
    found = published_layers(
        np.full((2, 3, 3), 0.4),
        np.zeros((2, 3, 3)),
        warm_to_cool,
        model.tensor,
        model.published,
    )

    assert found.shape == (3, 2, 3, 3)
    assert not found.any()


def test_dark_and_negative_pixels_stay_finite(model: Model, warm_to_cool: Floats64) -> None:
    rng = np.random.default_rng(1)
    no_flash, flash = rng.normal(0, 1e-3, (2, 20, 20, 3)).astype(np.float32)

    found = published_layers(no_flash, flash, warm_to_cool, model.tensor, model.published)

    assert np.isfinite(found).all()
