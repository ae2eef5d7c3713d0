from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.photometric_stereo.responses import LampBank, ResponsePrior
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light, reflectance_spectra


def seen(camera: Camera, light: Floats64) -> Floats64:
    """Reflectances (m, 3) as the camera sees them, a white card having green 1."""
    s = camera.sensitivities
    return np.asarray(reflectance_spectra() @ (s * light).T / (s[1] @ light))


def white(camera: Camera, light: Floats64) -> Floats64:
    s = camera.sensitivities
    return np.asarray(s @ light / (s[1] @ light))


def under(lamp: str, bank: LampBank, camera: Camera) -> tuple[ResponsePrior, Floats64, Floats64]:
    """The prior of a lamp, and reflectances (m, 3) under the flash and under the lamp."""
    light = find_light(lamp)
    prior = bank.prior(white(camera, light))
    return prior, seen(camera, find_light("xenon")), seen(camera, light)


@pytest.mark.parametrize("lamp", ["A", "D50", "FL2", "LED-B3"])
@pytest.mark.parametrize("strength", [1.0, 3.0])
def test_a_grey_card_has_the_lamps_colour(
    bank: LampBank, camera: Camera, lamp: str, strength: float
) -> None:
    colour = strength * white(camera, find_light(lamp))

    prior = bank.prior(colour)

    np.testing.assert_allclose(prior.mean @ bank.flash_white, colour, rtol=0.01)


@pytest.mark.parametrize("lamp", ["A", "D50", "FL2", "HP1"])
def test_surfaces_lie_within_what_the_prior_allows(
    bank: LampBank, camera: Camera, lamp: str
) -> None:
    """Nearly all light of a lamp is what its mean matrix says, and none is far off."""
    prior, flash, lit = under(lamp, bank, camera)

    off = np.linalg.norm(flash @ prior.mean.T - lit, axis=1) / np.linalg.norm(lit, axis=1)

    assert np.median(off) < 0.1
    best = np.linalg.lstsq(flash, lit, rcond=None)[0].T - prior.mean
    modes = prior.modes.reshape(len(prior.modes), 9).T
    along = np.linalg.lstsq(modes, best.ravel(), rcond=None)[0]
    assert np.linalg.norm(modes @ along - best.ravel()) < 0.3 * np.linalg.norm(best)
    assert np.abs(along).max() < 3


@pytest.mark.parametrize("lamp", ["A", "D50", "FL2", "LED-B3", "HP1"])
def test_materials_may_be_ten_times_as_far_off_as_they_are(
    bank: LampBank, camera: Camera, lamp: str
) -> None:
    """About a tenth of the prior's deviation, whichever colours it mixes."""
    prior, flash, lit = under(lamp, bank, camera)

    own = (lit - flash @ prior.mean.T) / flash.sum(axis=1, keepdims=True)
    whitened = np.linalg.solve(prior.material, own.T)

    size = np.sqrt(np.square(whitened).mean(axis=1))
    assert (size > 0.04).all()
    assert (size < 0.3).all()


def test_modes_leave_the_grey_card_alone_but_for_the_strength(
    bank: LampBank, camera: Camera
) -> None:
    colour = white(camera, find_light("A"))

    prior = bank.prior(colour)

    moved = prior.modes @ bank.flash_white
    assert np.abs(moved[:-1]).max() < 0.05 * np.linalg.norm(colour)
    np.testing.assert_allclose(moved[-1], 0.5 * (prior.mean @ bank.flash_white))


def test_a_colour_that_was_not_measured_may_be_off(bank: LampBank, camera: Camera) -> None:
    colour = white(camera, find_light("A"))

    measured, found = bank.prior(colour), bank.prior(colour, measured=False)

    assert len(found.modes) == len(measured.modes) + 3
    moved = found.modes[-3:] @ bank.flash_white
    np.testing.assert_allclose(moved, 0.1 * np.diag(found.mean @ bank.flash_white), atol=1e-9)


@pytest.mark.parametrize("colour", [(1.0, 0.02, 0.001), (0.0, 1.0, 0.0), (0.01, 0.1, 1.0)])
def test_colours_of_filters_are_possible(
    bank: LampBank, colour: tuple[float, float, float]
) -> None:
    prior = bank.prior(np.array(colour))

    assert np.isfinite(prior.mean).all()
    assert np.isfinite(prior.modes).all()
    assert np.isfinite(prior.material).all()
    np.testing.assert_allclose(prior.mean @ bank.flash_white, colour, atol=0.05 * max(colour))


def test_the_prior_changes_smoothly_with_the_colour(bank: LampBank, camera: Camera) -> None:
    warm, cool = (white(camera, find_light(name)) for name in ("A", "D65"))
    path = [bank.prior(warm + t * (cool - warm)).mean for t in np.linspace(0, 1, 21)]

    steps = [np.linalg.norm(b - a) for a, b in pairwise(path)]

    assert max(steps) < 6 * np.mean(steps)


def test_a_lamp_is_told_by_the_matrix_that_separated_it(bank: LampBank, camera: Camera) -> None:
    """Of any scale; along all modes but that of its strength, which such a matrix does not tell."""
    colour = white(camera, find_light("FL2"))
    usual = bank.prior(colour)
    along = np.array([0.8, -0.5, 0.3, 0.6, -0.4, 0.2, 0.0])
    matrix = usual.mean + np.einsum("k,kxy->xy", along, usual.modes)

    prior = bank.prior(colour, separated=4 * matrix)

    np.testing.assert_array_equal(usual.found, 0)
    np.testing.assert_array_equal(prior.mean, usual.mean)
    found = prior.mean + np.einsum("k,kxy->xy", prior.found, prior.modes)
    assert np.linalg.norm(found - matrix) < 0.1 * np.linalg.norm(usual.mean - matrix)
