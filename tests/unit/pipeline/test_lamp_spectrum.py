from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.lamp_spectrum import SpectrumPrior, learn_spectra
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light, lamp_spectra
from pipeline.spectra.matrices import best_matrix

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def prior(camera: Camera) -> SpectrumPrior:
    return learn_spectra(camera.sensitivities, find_light("xenon"))


def matrix_of(light: Array, camera: Camera) -> Array:
    s = camera.sensitivities
    return best_matrix(s * find_light("xenon"), s * light)


def off(found: Array, light: Array) -> float:
    """Sine of the angle between two spectra."""
    cosine = found @ light / np.linalg.norm(found) / np.linalg.norm(light)
    return float(np.sqrt(1 - cosine**2))


@pytest.mark.parametrize(("name", "most"), [("A", 0.45), ("D65", 0.3), ("FL2", 0.3)])
@pytest.mark.parametrize("scale", [0.01, 1.0, 50.0])
def test_a_lamp_is_known_by_its_matrix(
    camera: Camera, prior: SpectrumPrior, name: str, most: float, scale: float
) -> None:
    """Better than by the mean of all lamps, whatever its strength."""
    light = find_light(name)

    found = prior.spectrum(scale * matrix_of(light, camera))

    assert off(found, light) < most
    assert off(found, light) < 0.7 * off(prior.mean, light)


def test_on_average_a_matrix_tells_much_of_the_spectrum(
    camera: Camera, prior: SpectrumPrior
) -> None:
    found = [off(prior.spectrum(matrix_of(one, camera)), one) for one in lamp_spectra()]
    unknown = [off(prior.mean, one) for one in lamp_spectra()]

    assert np.mean(found) < 0.75 * np.mean(unknown)


def test_its_white_card_has_the_colour_of_the_matrix(camera: Camera, prior: SpectrumPrior) -> None:
    for name in ("A", "D150", "FL2", "LED-RGB1"):
        light = find_light(name)

        seen = camera.sensitivities @ prior.spectrum(matrix_of(light, camera))

        white = camera.sensitivities @ light
        assert off(seen, white) < 0.05


def test_the_mean_lamp_is_found_again(camera: Camera, prior: SpectrumPrior) -> None:
    np.testing.assert_allclose(
        prior.spectrum(matrix_of(prior.mean, camera)), prior.mean, rtol=1e-6, atol=1e-12
    )


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), -np.eye(3)])
def test_a_matrix_without_light_tells_nothing(prior: SpectrumPrior, matrix: Array) -> None:
    np.testing.assert_array_equal(prior.spectrum(matrix), prior.mean)


def test_spectra_stay_positive(prior: SpectrumPrior) -> None:
    for row in np.eye(3):
        found = prior.spectrum(np.outer(row, row))

        assert (found >= 0.01 * prior.mean).all()
        assert found.max() > 0
