from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.spectra.bases import learn_basis
from pipeline.spectra.lights import lamp_spectra, reflectance_spectra
from tests.evaluation.spectra import (
    CAMERAS,
    angle_deg,
    lamps,
    reflectances,
    sensitivities,
)


def nearest(a: Floats64, b: Floats64) -> float:
    """Largest cosine between a spectrum of the one and one of the other."""
    unit = [s / np.linalg.norm(s, axis=1, keepdims=True) for s in (a, b)]
    return float((unit[0] @ unit[1].T).max())


def test_halves_share_no_spectrum_nor_a_twin_with_each_other_or_the_bases() -> None:
    lights = [lamps("development").spectra, lamps("report").spectra]
    surfaces = [reflectances("development"), reflectances("report")]

    assert nearest(*lights) <= 0.999
    assert nearest(*surfaces) <= 0.999
    assert nearest(np.concatenate(lights), lamp_spectra()) <= 0.999
    assert nearest(np.concatenate(surfaces), reflectance_spectra()) <= 0.999


def test_halves_hold_a_hundred_lamps_and_hundreds_of_surfaces() -> None:
    for half in (lamps("development"), lamps("report")):
        assert half.spectra.shape == (len(half.names), 81)
        assert len(half.names) > 90
        assert 70 < half.broad.sum() < len(half.names)
        np.testing.assert_allclose(half.spectra.sum(axis=1), 1)
        assert half.spectra.min() >= 0
    table = np.concatenate([reflectances("development"), reflectances("report")])
    assert len(table) > 800
    assert table.min() >= 0
    assert table.max() <= 1


def test_broad_lamps_are_those_without_lines() -> None:
    kinds: dict[bool, set[str]] = {True: set(), False: set()}
    for half in (lamps("development"), lamps("report")):
        for name, broad in zip(half.names, half.broad, strict=True):
            kinds[bool(broad)].add(name.rpartition("(")[2].rstrip(")"))
    assert "Incandescent/Filament" in kinds[True] - kinds[False]
    assert "Fluorescent Narrowband" in kinds[False]


@pytest.mark.parametrize("camera", CAMERAS)
def test_cameras_see_three_colours_in_their_order(camera: str) -> None:
    s = sensitivities(camera)
    assert s.max() == 1
    blue, green, red = (380 + 5 * np.argmax(s[channel]) for channel in (2, 1, 0))
    assert 430 <= blue < green < red <= 640


def test_the_angle_between_lamps_is_taken_in_an_orthonormal_basis() -> None:
    camera = "Nikon D5100"
    basis = learn_basis("wpca", sensitivities(camera), reflectance_spectra(), lamp_spectra())
    orthonormal = np.linalg.inv(basis.published).T @ basis.lights
    np.testing.assert_allclose(orthonormal @ orthonormal.T, np.eye(3), atol=1e-9)
    # lamps that lie in the basis have their own angle
    mixtures = np.array([[1.0, 0.2, 0.1], [0.7, -0.3, 0.2]]) @ orthonormal
    cosine = np.prod([1 / np.linalg.norm(m) for m in mixtures]) * (mixtures[0] @ mixtures[1])
    found = angle_deg(mixtures[0], mixtures[1], camera)
    assert found == pytest.approx(np.degrees(np.arccos(cosine)), abs=0.01)
    assert angle_deg(mixtures[0], 3 * mixtures[0], camera) == pytest.approx(0, abs=1e-6)
