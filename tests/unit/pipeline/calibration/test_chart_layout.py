from __future__ import annotations

import numpy as np
import pytest

from pipeline.calibration.chart_layout import CORNER_NAMES, CORNERS, colour_misfit, tint_misfit
from pipeline.spectra.colorchecker import COLUMNS, colorchecker_spectra
from pipeline.spectra.observer import cie_1931

XYZ = colorchecker_spectra() @ cie_1931().T


def test_corners_are_those_of_the_names() -> None:
    """Neutral patches are the last row, dark skin and bluish green the ends of the first."""
    spectra = colorchecker_spectra()
    numbers = dict(zip(CORNER_NAMES, (CORNERS @ [1, COLUMNS]).astype(int), strict=True))

    assert numbers == {"dark skin": 0, "bluish green": 5, "black": 23, "white": 18}
    means = spectra.mean(axis=1)
    assert means[numbers["white"]] == means.max()
    assert means[numbers["black"]] == means.min()


def test_a_matrix_of_the_patches_colours_leaves_nothing() -> None:
    light = XYZ @ np.array([[0.9, 0.2, 0.1], [0.1, 1.0, 0.0], [0.0, 0.1, 0.7]])

    assert colour_misfit(light) == pytest.approx(0, abs=1e-9)
    assert colour_misfit(7 * light) == pytest.approx(0, abs=1e-9)


def test_patches_in_another_order_leave_much() -> None:
    assert colour_misfit(XYZ[::-1]) > 0.3


def test_some_of_the_patches_are_held_against_their_own_colours() -> None:
    light, some = XYZ @ np.diag([0.9, 1.0, 0.7]), np.array([3, 17, 0, 8, 21, 12])

    assert colour_misfit(light[some], some) == pytest.approx(0, abs=1e-9)
    assert colour_misfit(light[some], np.roll(some, 1)) > 0.2


def test_tints_are_told_however_bright_patches_are() -> None:
    light = XYZ @ np.array([[0.9, 0.2, 0.1], [0.1, 1.0, 0.0], [0.0, 0.1, 0.7]])
    bright = np.random.default_rng(1).uniform(0.05, 1.0, (24, 1))

    assert tint_misfit(light) < 0.04
    assert tint_misfit(bright * light) == pytest.approx(tint_misfit(light), abs=1e-9)


def test_tints_of_other_places_and_of_none_are_unlike() -> None:
    """Of one grey there is no spread but noise."""
    random = np.random.default_rng(1)
    shuffled = [tint_misfit(random.permutation(XYZ)) for _ in range(50)]
    grey = random.uniform(0.2, 1, (24, 1)) * random.normal(1, 0.01, (24, 3))

    assert min(shuffled) > 0.6
    assert tint_misfit(XYZ.reshape(4, 6, 3)[:, ::-1].reshape(24, 3)) > 0.6
    assert tint_misfit(grey) > 0.6
