from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.model import Response, build_model
from pipeline.response import other_response
from pipeline.separation import Strip
from pipeline.spectra.cameras import Camera, srgb_stand_in
from pipeline.spectra.lights import find_light, reflectance_spectra

Array = NDArray[np.float64]
Exact = Callable[..., tuple[Any, Array]]


def strip_of(layers: Array) -> Strip:
    """Layers alone: nothing else is needed."""
    shape = layers.shape[1:]
    return Strip(
        rows=slice(0, shape[0]),
        layers=layers.astype(np.float32),
        no_flash=np.zeros(shape, np.float32),
        flash=np.zeros(shape, np.float32),
        confidence=np.zeros(shape[:2], np.float32),
    )


@pytest.fixture(scope="module")
def through(camera: Camera) -> Callable[[Camera], Response]:
    """How another camera answers where the first one took the photograph."""

    def build(other: Camera) -> Response:
        model = build_model(camera, find_light("xenon"), find_light("D65"), "wpca", other)
        assert model.response is not None
        return model.response

    return build


@pytest.mark.parametrize("count", [1, 2, 3])
def test_through_the_same_camera_the_photograph_is_the_photograph(
    exact: Exact,
    camera: Camera,
    through: Callable[[Camera], Response],
    lamps_of: Callable[..., Any],
    warm_to_cool: Array,
    count: int,
) -> None:
    pair, layers = exact(warm_to_cool[:count])

    found = other_response(strip_of(layers), lamps_of(warm_to_cool[:count]), through(camera))

    assert found.dtype == np.float32
    np.testing.assert_allclose(found, pair.no_flash, atol=1e-5)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_through_another_camera_layers_are_those_of_its_own_model(
    exact: Exact,
    through: Callable[[Camera], Response],
    lamps_of: Callable[..., Any],
    shares_of: Callable[[int], Array],
    flash_part: NDArray[np.float32],
    warm_to_cool: Array,
    count: int,
) -> None:
    """Σ_j z_j T'_j I_f."""
    _, layers = exact(warm_to_cool[:count])
    response = through(srgb_stand_in())

    found = other_response(strip_of(layers), lamps_of(warm_to_cool[:count]), response)

    lit = np.einsum("klj,nj,hwl->nhwk", response.tensor, warm_to_cool[:count], flash_part)
    expected = (shares_of(count)[..., None] * lit).sum(axis=0)
    np.testing.assert_allclose(found, np.maximum(expected, 0), atol=1e-4)


@pytest.mark.parametrize("light", ["A", "D65"])
def test_another_camera_sees_measured_surfaces_nearly_as_it_would(
    camera: Camera,
    through: Callable[[Camera], Response],
    lamps_of: Callable[..., Any],
    light: str,
) -> None:
    """Rendered from spectra for both cameras; the second exposed to the same green of daylight."""
    other = srgb_stand_in()
    spectrum, daylight = find_light(light), find_light("D65")
    here = reflectance_spectra() @ (camera.sensitivities * spectrum).T
    there = reflectance_spectra() @ (other.sensitivities * spectrum).T
    there = there * (camera.sensitivities @ daylight)[1] / (other.sensitivities @ daylight)[1]
    white = camera.sensitivities @ spectrum
    lamps = lamps_of(white / np.linalg.norm(white))

    found = other_response(strip_of(here[None, :, None]), lamps, through(other))[:, 0]

    error = np.square(found - there).sum() / np.square(there).sum()
    assert 10 * np.log10(1 / error) > 20


def test_dark_and_negative_layers_give_nothing_negative(
    camera: Camera,
    through: Callable[[Camera], Response],
    lamps_of: Callable[..., Any],
    warm_to_cool: Array,
) -> None:
    layers = np.random.default_rng(2).normal(0, 0.001, (3, 8, 9, 3))

    found = other_response(strip_of(layers), lamps_of(warm_to_cool), through(camera))

    assert found.shape == (8, 9, 3)
    assert found.min() >= 0
    assert found.max() < 0.1


@pytest.mark.parametrize("blue", [0.01, -0.01])
def test_a_lamp_without_blue_asks_for_no_blue(
    camera: Camera,
    through: Callable[[Camera], Response],
    lamps_of: Callable[..., Any],
    blue: float,
) -> None:
    """Its matrix has no inverse worth the name, and yet noise does not explode."""
    yellow = np.array([0.8, 0.6, 0.0])
    lamps = lamps_of(yellow, matrices=np.array([[[1, 0.1, 0], [0.1, 0.9, 0], [0, 1e-6, 1e-5]]]))
    layers = np.full((1, 4, 5, 3), 0.2)
    layers[..., 2] = blue

    found = other_response(strip_of(layers), lamps, through(camera))

    assert found.max() < 2
