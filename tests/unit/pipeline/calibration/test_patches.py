from __future__ import annotations

import numpy as np
import pytest

from pipeline.calibration.patches import Patches
from pipeline.spectra.colorchecker import colorchecker_spectra

_PLACES = np.array([(x, y) for y in (-0.6, -0.2, 0.2, 0.6) for x in np.linspace(-1, 1, 6)])


def _patches(flash: np.ndarray) -> Patches:
    return Patches(flash, np.full_like(flash, 1e-8), colorchecker_spectra(), _PLACES)


def test_the_fall_off_is_found_beside_the_colours() -> None:
    even = np.random.default_rng(2).uniform(0.1, 0.8, (24, 3))
    x, y = _PLACES.T
    field = np.exp(-0.3 * x + 0.1 * y - 0.2 * x * x + 0.15 * x * y + 0.1 * y * y)
    field /= np.exp(np.log(field).mean())
    found = _patches(even * field[:, None]).fall_off(7.0 * even)
    assert found[:, 0] == pytest.approx(field, rel=1e-6)


def test_the_fall_off_is_told_by_patches_that_are_bright_and_sure() -> None:
    """Glare on the darkest patch, and noise on another, hardly count."""
    even = np.full((24, 3), 0.5)
    even[23] = 0.001
    seen, variance = even.copy(), np.full((24, 3), 1e-8)
    seen[23] += 0.003
    seen[0] *= 1.5
    variance[0] = 1.0
    found = Patches(seen, variance, colorchecker_spectra(), _PLACES).fall_off(even)
    assert found[1:23] == pytest.approx(np.ones((22, 1)), abs=0.02)


@pytest.mark.parametrize("count", [2, 6])
def test_as_many_patches_as_unknowns_tell_no_fall_off(count: int) -> None:
    flash = np.random.default_rng(2).uniform(0.1, 0.8, (count, 3))
    variance = np.full_like(flash, 1e-8)
    few = Patches(flash, variance, colorchecker_spectra()[:count], _PLACES[4 : 4 + count])
    assert few.fall_off(np.ones((count, 3))) == pytest.approx(np.ones((count, 1)))


def test_few_patches_have_no_fall_off() -> None:
    one = Patches(np.ones((1, 3)), np.zeros((1, 3)), np.ones((1, 81)), np.zeros((1, 2)))
    assert one.fall_off(np.full((1, 3), 5.0)) == pytest.approx(np.ones((1, 1)))


def test_misfit_is_relative_with_dark_patches_counting_little() -> None:
    flash = np.full((24, 3), 1.0)
    assert _patches(flash).misfit(1.1 * flash) == pytest.approx(0.1 / 1.02)
    flash[23] = 0.0
    off = flash.copy()
    off[23] = 0.02
    assert _patches(flash).misfit(off) == pytest.approx(np.sqrt(1 / 24))


def test_noise_alone_is_a_misfit_by_the_same_measure() -> None:
    flash = np.full((24, 3), 1.0)
    variance = np.full((24, 3), 0.051**2)
    noisy = Patches(flash, variance, colorchecker_spectra(), _PLACES)
    assert noisy.noise == pytest.approx(0.05)
    assert noisy.noise == pytest.approx(noisy.misfit(flash + 0.051))


def test_the_tolerance_adds_noise_pigments_and_glare() -> None:
    flash = np.full((24, 3), 0.5)
    flash[0] = 1.0
    tolerance = _patches(flash).tolerance
    assert tolerance[0, 0] == pytest.approx(1e-8 + 0.015**2 + 0.003**2)
    assert tolerance[1, 0] == pytest.approx(1e-8 + 0.0075**2 + 0.003**2)
