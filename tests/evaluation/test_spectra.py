from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.spectra.lights import lamp_spectra, reflectance_spectra
from tests.evaluation.spectra import (
    CAMERAS,
    angle_deg,
    lamps,
    reflectances,
    sensitivities,
)

Array = NDArray[np.float64]


def nearest(a: Array, b: Array) -> float:
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


def test_the_angle_between_lamps_is_that_between_white_cards() -> None:
    a, b = lamps("report").spectra[[3, 40]]
    s = sensitivities("Nikon D5100")
    u, v = s @ a, s @ b
    expected = np.degrees(np.arccos(u @ v / np.linalg.norm(u) / np.linalg.norm(v)))
    assert angle_deg(a, b, "Nikon D5100") == pytest.approx(expected)
    assert angle_deg(a, 3 * a, "Nikon D5100") == pytest.approx(0, abs=1e-9)
