from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.light.model import Model, Response, build_model
from pipeline.options import Method
from pipeline.pictures.response import camera_changes, other_response
from pipeline.spectra.cameras import Camera, find_camera, srgb_stand_in
from pipeline.spectra.lights import find_light, reflectance_spectra

Exact = Callable[..., tuple[Any, Floats64]]
METHODS: tuple[Method, ...] = ("best", "paper")


@pytest.fixture(scope="module")
def through(camera: Camera) -> Callable[[Camera], Response]:
    """How another camera answers where the first one took the photograph."""

    def build(other: Camera) -> Response:
        model = build_model(camera, find_light("xenon"), find_light("D65"), "wpca", other)
        assert model.response is not None
        return model.response

    return build


@pytest.fixture(scope="module")
def other(frame: Callable[..., Any]) -> Camera:
    """Another measured camera."""
    return find_camera("Sigma SD1 Merrill", frame(np.zeros((2, 2, 3))))


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("method", METHODS)
def test_through_the_same_camera_the_photograph_is_the_photograph(
    exact: Exact,
    camera: Camera,
    model: Model,
    through: Callable[[Camera], Response],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    count: int,
    method: Method,
) -> None:
    pair, layers = exact(warm_to_cool[:count])
    changes = camera_changes(lamps_of(warm_to_cool[:count]), model, through(camera), method)

    found = other_response(layers.astype(np.float32), changes)

    assert found.dtype == np.float32
    np.testing.assert_allclose(found, pair.no_flash, atol=1e-5)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_paper_takes_layers_of_the_other_cameras_model(
    exact: Exact,
    model: Model,
    through: Callable[[Camera], Response],
    lamps_of: Callable[..., Any],
    shares_of: Callable[[int], Floats64],
    flash_part: Floats32,
    warm_to_cool: Floats64,
    count: int,
) -> None:
    """Σ_j z_j T'_j I_f."""
    _, layers = exact(warm_to_cool[:count])
    response = through(srgb_stand_in())
    changes = camera_changes(lamps_of(warm_to_cool[:count]), model, response, "paper")

    found = other_response(layers.astype(np.float32), changes)

    lit = np.einsum("klj,nj,hwl->nhwk", response.tensor, warm_to_cool[:count], flash_part)
    expected = (shares_of(count)[..., None] * lit).sum(axis=0)
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize("light", ["A", "D65", "FL2"])
def test_another_camera_sees_measured_surfaces_as_it_would(
    camera: Camera,
    other: Camera,
    model: Model,
    through: Callable[[Camera], Response],
    lamps_of: Callable[..., Any],
    light: str,
) -> None:
    """Rendered from spectra for both cameras; the second exposed to the same green of daylight."""
    spectrum, daylight, flash = find_light(light), find_light("D65"), find_light("xenon")
    here = reflectance_spectra() @ (camera.sensitivities * spectrum).T
    there = reflectance_spectra() @ (other.sensitivities * spectrum).T
    there = there * (camera.sensitivities @ daylight)[1] / (other.sensitivities @ daylight)[1]
    white = camera.sensitivities @ spectrum
    by_flash = reflectance_spectra() @ (camera.sensitivities * flash).T
    matrix = np.linalg.lstsq(by_flash, here, rcond=None)[0].T
    lamps = lamps_of(white / np.linalg.norm(white), matrices=matrix[None])
    response = through(other)

    degrees = {}
    brightness = 0.0
    for method in reversed(METHODS):
        changes = camera_changes(lamps, model, response, method)
        found = other_response(here[None, :, None].astype(np.float32), changes)[:, 0].astype(
            np.float64
        )
        across = np.linalg.norm(np.cross(found, there), axis=1)
        degrees[method] = np.degrees(np.arctan2(across, (found * there).sum(axis=1))).mean()
        brightness = found[:, 1].mean() / there[:, 1].mean()

    assert degrees["best"] < 1
    assert degrees["best"] < degrees["paper"]
    assert brightness == pytest.approx(1, abs=0.03)


def test_the_brightness_of_daylight_stays(
    camera: Camera,
    other: Camera,
    model: Model,
    through: Callable[[Camera], Response],
    lamps_of: Any,
) -> None:
    """Both cameras are exposed so that green sees the same of a white card in daylight."""
    white = camera.sensitivities @ find_light("D65")
    lamps = lamps_of(white / np.linalg.norm(white))

    change = camera_changes(lamps, model, through(other), "best")[0]

    seen = other.sensitivities @ find_light("D65")
    np.testing.assert_allclose(change @ (white / white[1]), seen / seen[1], rtol=0.02)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("blue", [0.01, -0.01])
def test_a_lamp_without_blue_asks_for_no_blue(
    model: Model,
    through: Callable[[Camera], Response],
    camera: Camera,
    lamps_of: Callable[..., Any],
    method: Method,
    blue: float,
) -> None:
    """Its matrix has no inverse worth the name, and yet noise does not explode."""
    yellow = np.array([0.8, 0.6, 0.0])
    lamps = lamps_of(yellow, matrices=np.array([[[1, 0.1, 0], [0.1, 0.9, 0], [0, 1e-6, 1e-5]]]))
    layers = np.full((1, 4, 5, 3), 0.2)
    layers[..., 2] = blue

    found = other_response(
        layers.astype(np.float32), camera_changes(lamps, model, through(camera), method)
    )

    assert np.abs(found).max() < 2


def test_layers_of_every_lamp_are_changed_by_its_own_matrix() -> None:
    layers = np.random.default_rng(2).normal(0.1, 0.2, (3, 8, 9, 3))
    changes = np.random.default_rng(3).normal(0, 1, (3, 3, 3))

    found = other_response(layers.astype(np.float32), changes)

    np.testing.assert_allclose(found, np.einsum("nhwl,nkl->hwk", layers, changes), atol=1e-5)
