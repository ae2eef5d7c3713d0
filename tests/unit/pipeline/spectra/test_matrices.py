from __future__ import annotations

import numpy as np
import pytest

from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.matrices import balancing_matrix, best_matrix, by_spectrum


def test_a_change_of_gains_is_found_exactly(camera: Camera) -> None:
    before = camera.sensitivities * find_light("D65")
    gains = np.array([2.0, 1.0, 0.5])

    found = best_matrix(before, gains[:, None] * before)

    np.testing.assert_allclose(found, np.diag(gains), atol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_errors_count_relative_to_brightness(camera: Camera, sign: float) -> None:
    """No other matrix brings the mean square of error ÷ brightness down, whatever the signs."""
    before = camera.sensitivities * find_light("D65") * [[1.0], [1.0], [sign]]
    after = camera.sensitivities * find_light("A")
    seen, wanted = reflectance_spectra() @ before.T, reflectance_spectra() @ after.T

    def error(matrix: np.ndarray) -> float:
        off = (seen @ matrix.T - wanted) / np.abs(seen).sum(axis=1, keepdims=True)
        return float(np.square(off).sum())

    best = best_matrix(before, after)
    random = np.random.default_rng(1)
    least = error(best)
    assert all(error(best + 1e-3 * random.normal(size=(3, 3))) > least for _ in range(50))


@pytest.mark.parametrize("name", ["A", "FL2", "LED-B1"])
def test_the_matrix_is_linear_in_the_spectrum(camera: Camera, name: str) -> None:
    s, flash, light = camera.sensitivities, find_light("xenon"), find_light(name)

    found = by_spectrum(s, s * flash) @ light

    np.testing.assert_allclose(found, best_matrix(s * flash, s * light), rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("name", ["A", "FL2", "LED-B1"])
def test_white_stays_white_and_no_matrix_that_keeps_it_errs_less(camera: Camera, name: str) -> None:
    before, after = (camera.sensitivities * find_light(light) for light in ("xenon", name))
    seen, wanted = reflectance_spectra() @ before.T, reflectance_spectra() @ after.T

    def error(matrix: np.ndarray) -> float:
        return float(np.square((seen @ matrix.T - wanted) / seen.sum(axis=1)[:, None]).sum())

    found = balancing_matrix(before, after)

    white = before.sum(axis=1)
    np.testing.assert_allclose(found @ white, after.sum(axis=1), rtol=1e-9)
    random = np.random.default_rng(1)
    for _ in range(50):
        other = random.normal(size=(3, 3))
        other -= np.outer(other @ white, white) / (white @ white)
        assert error(found + 1e-3 * other) > error(found)
