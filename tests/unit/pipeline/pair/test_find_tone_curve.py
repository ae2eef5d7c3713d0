"""Shadows of two lamps and a flash without edges on patches of paint, through curves."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.curves import linear_to_srgb, srgb_to_linear
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.find_tone_curve import find_tone_curve, usual_contrasts
from pipeline.pair.tone_curve import ToneCurve
from tests.unit.pipeline.pair.shadows_on_paint import (
    SIZE,
    Curve,
    light_of,
    neighbours,
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
    found = find_tone_curve(neighbours(photographs(curve, light_of())))

    assert found is not None
    assert off(found, curve) < most
    nothing_taken_off = ToneCurve(np.zeros(11))
    assert off(found, curve) < 0.4 * off(nothing_taken_off, curve)


@pytest.mark.parametrize("shadows", ["upright", "level"])
def test_edges_that_run_one_way_tell_it(shadows: Literal["upright", "level"]) -> None:
    found = find_tone_curve(neighbours(photographs(s_curve(S), light_of(shadows))))

    assert found is not None
    assert off(found, s_curve(S)) < 0.02


def test_a_contrast_is_found_through_a_balance_that_differs() -> None:
    no_flash, flash = light_of()
    change = BalanceChange(1.3, 0.75)
    other = flash @ np.linalg.inv(change.matrix).T
    pair = photographs(s_curve(S), (no_flash, 0.75 * other))

    found = find_tone_curve(neighbours(pair, 0.75), change)

    assert found is not None
    assert off(found, s_curve(S)) < 0.016


def test_the_curve_of_srgb_alone_stays() -> None:
    assert find_tone_curve(neighbours(photographs(s_curve(0.0), light_of()))) is None


def test_a_curve_that_no_camera_has_is_not_taken() -> None:
    """Values of light as if it were roots of code values."""
    pair = photographs(lambda codes: codes**2.2, light_of())

    assert find_tone_curve(neighbours(pair)) is None


def test_a_curve_that_is_nearly_level_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = neighbours(photographs(s_curve(S), light_of()))
    monkeypatch.setattr(ToneCurve, "rises", property(lambda _: False))

    assert find_tone_curve(seen) is None


def test_the_ratio_of_exposures_is_taken_off_the_light_not_the_codes() -> None:
    no_flash, flash = light_of()
    pair = photographs(s_curve(S), (no_flash, 0.5 * flash))

    found = find_tone_curve(neighbours(pair, 0.5))

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

    found = find_tone_curve(neighbours((no_flash, other), unusable=unusable))

    assert found is not None
    assert off(found, s_curve(S)) < 0.016


def test_exposures_that_nobody_knows_may_explain_as_much() -> None:
    """The true ratio is 1, and the flash photograph was taken for half as much brighter."""
    wrong = neighbours(photographs(s_curve(0.0), light_of()), 1.5)
    right = neighbours(photographs(s_curve(S), light_of()))

    assert find_tone_curve(wrong) is not None
    assert find_tone_curve(wrong, exposures_known=False) is None
    assert find_tone_curve(right, exposures_known=False) is not None


def test_colour_that_a_curve_takes_out_of_all_things_tells_nothing() -> None:
    """Half as bright, all paints look alike through the strongest of the usual contrasts."""
    no_flash, flash = light_of()
    few = neighbours(photographs(s_curve(S), (no_flash, 0.5 * flash)), 0.5)
    strongest = few.through(ToneCurve(usual_contrasts()[-1].logs))
    right = few.through(ToneCurve(usual_contrasts()[2].logs))
    nothing_taken_off, widths = np.zeros(2), (0.06, 0.15)

    assert strongest.height(nothing_taken_off, widths) > right.height(nothing_taken_off, widths)
    assert strongest.excess(nothing_taken_off, widths) < 0.5 * right.excess(
        nothing_taken_off, widths
    )
