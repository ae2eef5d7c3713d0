"""Shadows of two lamps and a flash without edges on patches of paint, through curves."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.curves import linear_to_srgb, srgb_to_linear
from pipeline.pair.find_tone_curve import find_tone_curve
from pipeline.pair.tone_curve import ToneCurve
from tests.unit.pipeline.pair.shadows_on_paint import (
    SIZE,
    Curve,
    light_of,
    nothing,
    photographs,
    s_curve,
)

S, STRONGER = 0.05, 0.08


def brighter(codes: Floats64) -> Floats64:
    """Middle tones brighter, highlights flatter."""
    return np.asarray(1 - (1 - codes) ** 1.5)


def off(found: ToneCurve, curve: Curve) -> float:
    """Root mean square of code values that the light found has and the true one."""
    codes = np.linspace(0.15, 0.95, 81)
    seen = srgb_to_linear(curve(codes)).astype(np.float32)
    return float(np.sqrt(np.mean((linear_to_srgb(found.light(seen)) - codes) ** 2)))


@pytest.mark.parametrize(
    ("curve", "most"), [(s_curve(S), 0.015), (s_curve(STRONGER), 0.01), (brighter, 0.035)]
)
def test_a_contrast_is_found(curve: Curve, most: float) -> None:
    found = find_tone_curve(*photographs(curve, light_of()), nothing(), 1.0)

    assert found is not None
    assert off(found, curve) < most
    nothing_taken_off = ToneCurve(np.zeros(11))
    assert off(found, curve) < 0.4 * off(nothing_taken_off, curve)


@pytest.mark.parametrize("shadows", ["upright", "level"])
def test_edges_that_run_one_way_tell_it(shadows: Literal["upright", "level"]) -> None:
    found = find_tone_curve(*photographs(s_curve(S), light_of(shadows)), nothing(), 1.0)

    assert found is not None
    assert off(found, s_curve(S)) < 0.02


def test_a_contrast_is_found_through_a_balance_that_differs() -> None:
    no_flash, flash = light_of()
    gains = np.array((1.3, 1.0, 0.75))
    pair = photographs(s_curve(S), (no_flash, 0.8 * flash * gains))

    found = find_tone_curve(*pair, nothing(), 0.8, np.diag(1 / gains))

    assert found is not None
    assert off(found, s_curve(S)) < 0.016


def test_a_few_edges_are_not_enough() -> None:
    no_flash, flash = (one[:24, :72] for one in light_of("upright"))

    assert (
        find_tone_curve(*photographs(s_curve(S), (no_flash, flash)), nothing()[:24, :72], 1.0)
        is None
    )


def test_the_curve_of_srgb_alone_stays() -> None:
    assert find_tone_curve(*photographs(lambda codes: codes, light_of()), nothing(), 1.0) is None


def test_without_shadows_nothing_tells_the_curve() -> None:
    pair = photographs(s_curve(S), light_of("none"))

    assert find_tone_curve(*pair, nothing(), 1.0) is None


def test_a_flash_that_hardly_reaches_tells_nothing() -> None:
    pair = photographs(s_curve(S), light_of(flash=0.005))

    assert find_tone_curve(*pair, nothing(), 1.0) is None


def test_the_ratio_of_exposures_is_taken_off_the_light_not_the_codes() -> None:
    no_flash, flash = light_of()
    pair = photographs(s_curve(S), (no_flash, 0.5 * flash))

    found = find_tone_curve(*pair, nothing(), 0.5)

    assert found is not None
    assert off(found, s_curve(S)) < 0.016


def test_what_cannot_be_used_does_not_count() -> None:
    """In the right half the flash photograph shows something else."""
    no_flash, flash = photographs(s_curve(S), light_of())
    other = flash[:].copy()
    half = SIZE[0] // 2
    other[:, half:] = np.roll(other[:, half:], 17, axis=0)
    unusable = nothing()
    unusable[:, half:] = True

    found = find_tone_curve(no_flash, other, unusable, 1.0)

    assert found is not None
    assert off(found, s_curve(S)) < 0.016


def test_all_that_cannot_be_used_tells_nothing() -> None:
    pair = photographs(s_curve(S), light_of())

    assert find_tone_curve(*pair, ~nothing(), 1.0) is None


def test_a_picture_smaller_than_a_step_tells_nothing() -> None:
    no_flash, flash = (np.full((6, 7, 3), light, np.float32) for light in (0.2, 0.4))

    assert find_tone_curve(no_flash, flash, np.zeros((6, 7), np.bool_), 1.0) is None
