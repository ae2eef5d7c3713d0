"""Ratios of paint in the shadows of two lamps, one photograph darker in its corners."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.pair.find_vignetting import find_vignetting
from pipeline.pair.vignetting import squared_radius
from tests.unit.pipeline.pair.ratios_of_scenes import ratios_of
from tests.unit.pipeline.pair.shadows_on_paint import SIZE, Shadows, light_of

WIDTH, HEIGHT = SIZE
RADIUS = squared_radius(HEIGHT, WIDTH)[..., None]


@pytest.mark.parametrize("darker", [0.2, 0.3, 0.5])
def test_dark_corners_of_the_flash_photograph_are_found(darker: float) -> None:
    lamps, both = light_of()

    found = find_vignetting(ratios_of(lamps, both * (1 - darker * RADIUS)))

    assert found is not None
    assert found.corners == pytest.approx(-darker, abs=0.04)


def test_those_of_the_other_make_its_corners_brighter() -> None:
    lamps, both = light_of()

    found = find_vignetting(ratios_of(lamps * (1 - 0.3 * RADIUS), both))

    assert found is not None
    more = 1 / (1 - 0.3 * RADIUS) - 1
    assert np.abs(found.corners * RADIUS - more).mean() < 0.04


@pytest.mark.parametrize("flash", [0.2, 0.35, 1.5])
@pytest.mark.parametrize("factor", [0.8, 0.9, 1.0, 1.2, 1.5])
def test_pairs_that_are_alike_have_none(factor: float, flash: float) -> None:
    """Whatever ratio of the exposures was given, and though the flash is dark in the corners."""
    alike = ratios_of(*light_of(flash=flash))

    assert find_vignetting(replace(alike, logs=alike.logs + np.log(factor))) is None


def test_dark_corners_of_both_are_alike() -> None:
    lamps, both = (light * (1 - 0.4 * RADIUS) for light in light_of())

    assert find_vignetting(ratios_of(lamps, both)) is None


def test_little_of_it_is_not_told() -> None:
    lamps, both = light_of()

    assert find_vignetting(ratios_of(lamps, both * (1 - 0.1 * RADIUS))) is None


@pytest.mark.parametrize(("shadows", "gain"), [("none", 1.0), ("slanted", 0.0)])
def test_even_light_and_no_flash_tell_nothing(shadows: Shadows, gain: float) -> None:
    lamps, both = light_of(shadows)
    flash = lamps * 0.9 + gain * (both - 0.9 * lamps)

    assert find_vignetting(ratios_of(lamps, flash * (1 - 0.3 * RADIUS))) is None


def test_where_nothing_can_be_used_nothing_is_told() -> None:
    lamps, both = light_of()
    ratios = ratios_of(lamps, both * (1 - 0.3 * RADIUS))

    assert find_vignetting(replace(ratios, usable=np.zeros_like(ratios.usable))) is None
