from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.light.lamp_spectrum import SpectrumPrior, learn_spectra
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light, lamp_spectra
from pipeline.spectra.matrices import best_matrix
from pipeline.spectra.wavelengths import WAVELENGTHS_NM


@pytest.fixture(scope="module")
def prior(camera: Camera) -> SpectrumPrior:
    return learn_spectra(camera.sensitivities, find_light("xenon"))


def matrix_of(light: Floats64, camera: Camera) -> Floats64:
    s = camera.sensitivities
    return best_matrix(s * find_light("xenon"), s * light)


def off(found: Floats64, light: Floats64) -> float:
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


def test_no_other_gain_errs_less_on_measured_lamps(camera: Camera, prior: SpectrumPrior) -> None:
    """With matrices off by 0.03 along a white card's colour and by 0.1 across it."""
    whites = [(matrix_of(one, camera) @ prior.flash_white).sum() for one in lamp_spectra()]
    lamps = lamp_spectra() / np.array(whites)[:, None]
    np.testing.assert_allclose(lamps.mean(axis=0), prior.mean, rtol=1e-6)
    matrices = np.array([matrix_of(one, camera).ravel() for one in lamps])
    np.testing.assert_allclose(matrices.mean(axis=0), prior.expected, rtol=1e-6)
    white = prior.flash_white / np.linalg.norm(prior.flash_white)
    across = np.linalg.svd(white[None])[2][1:]
    size = np.linalg.norm(prior.expected) / np.sqrt(3)
    steps = [
        size * amount * np.outer(channel, way).ravel()
        for channel in np.eye(3)
        for amount, way in ((0.03, white), (0.1, across[0]), (0.1, across[1]))
    ]

    def error(gain: Floats64) -> float:
        missed = lamps - prior.mean - (matrices - prior.expected) @ gain.T
        by_noise = np.array(steps) @ gain.T
        return float(np.square(missed).sum(axis=1).mean() + np.square(by_noise).sum())

    least, random = error(prior.gain), np.random.default_rng(4)
    for column in np.eye(9):
        step = 1e-3 * np.abs(prior.gain).max() * np.outer(random.normal(size=81), column)
        assert error(prior.gain + step) > least
        assert error(prior.gain - step) > least


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), -np.eye(3)])
def test_a_matrix_without_light_tells_nothing(prior: SpectrumPrior, matrix: Floats64) -> None:
    np.testing.assert_array_equal(prior.spectrum(matrix), prior.mean)


def test_spectra_stay_positive(prior: SpectrumPrior) -> None:
    for row in np.eye(3):
        found = prior.spectrum(np.outer(row, row))

        # a matrix that is no lamp's asks for less than nothing somewhere
        assert (found / prior.mean).min() == pytest.approx(0.01)
        assert found.max() > 0


@pytest.mark.parametrize("peak_nm", [450, 530, 650])
def test_a_lamp_of_one_colour_has_it(camera: Camera, prior: SpectrumPrior, peak_nm: int) -> None:
    light = np.exp(-0.5 * ((WAVELENGTHS_NM - peak_nm) / 15) ** 2)
    matrix = matrix_of(light, camera)

    found = prior.coloured(matrix)

    white = camera.sensitivities @ light
    assert off(camera.sensitivities @ found, white) < 0.02
    assert off(camera.sensitivities @ prior.spectrum(matrix), white) > 0.1
    assert found.min() > 0


@pytest.mark.parametrize("name", ["A", "D65", "FL11"])
def test_the_colour_of_a_white_lamp_hardly_changes_its_estimate(
    camera: Camera, prior: SpectrumPrior, name: str
) -> None:
    matrix = matrix_of(find_light(name), camera)
    white = matrix @ prior.flash_white

    found, estimate = prior.coloured(matrix), prior.spectrum(matrix)

    assert off(found, estimate) < 0.1
    assert off(camera.sensitivities @ found, white) < off(camera.sensitivities @ estimate, white)


@pytest.mark.parametrize("seen", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 0)])
def test_a_colour_that_no_light_has_becomes_the_nearest(
    prior: SpectrumPrior, seen: tuple[float, float, float]
) -> None:
    found = prior.coloured(np.diag(np.array(seen) / prior.flash_white))

    assert np.isfinite(found).all() and found.min() >= 0
    assert off(prior.sensitivities @ found, np.array(seen, float)) < 0.6


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), -np.eye(3)])
def test_a_matrix_without_light_tells_no_colour(prior: SpectrumPrior, matrix: Floats64) -> None:
    np.testing.assert_array_equal(prior.coloured(matrix), prior.mean)
