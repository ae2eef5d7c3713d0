"""Shadows of two lamps on patches of paint, the flash photograph with gains of red and blue."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.colour.curves import srgb_to_linear
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.find_balance_change import find_balance_change, settle_balance_change
from pipeline.pair.tone_curve import KNOTS, ToneCurve
from tests.unit.pipeline.pair.shadows_on_paint import (
    SIZE,
    neighbours,
    nothing,
    pair_of,
    s_curve,
)


@pytest.mark.parametrize("gains", [(1.3, 0.75), (0.75, 1.3), (1.12, 0.9), (1.0, 0.8)])
@pytest.mark.parametrize("contrast", [0.0, 0.05])
def test_gains_are_found(gains: tuple[float, float], contrast: float) -> None:
    found = find_balance_change(neighbours(pair_of(*gains, contrast), 0.75))

    assert found is not None
    np.testing.assert_allclose((found.red, found.blue), gains, rtol=0.03)


@pytest.mark.parametrize("contrast", [0.0, 0.05, 0.08])
def test_between_equal_balances_nothing_is_found(contrast: float) -> None:
    assert find_balance_change(neighbours(pair_of(1.0, 1.0, contrast), 0.75)) is None


def test_gains_too_small_to_be_told_surely_stay() -> None:
    assert find_balance_change(neighbours(pair_of(1.03, 0.97), 0.75)) is None


def test_what_cannot_be_used_does_not_count() -> None:
    """In the right half the flash photograph shows something else."""
    no_flash, flash = pair_of(1.3, 0.75)
    other = flash[:].copy()
    half = SIZE[0] // 2
    other[:, half:] = np.roll(other[:, half:], 17, axis=0)
    unusable = nothing()
    unusable[:, half:] = True

    found = find_balance_change(neighbours((no_flash, other), 0.75, unusable))

    assert found is not None
    np.testing.assert_allclose((found.red, found.blue), (1.3, 0.75), rtol=0.03)


@pytest.mark.parametrize("contrast", [0.0, 0.05])
def test_gains_are_followed_through_a_contrast_that_is_there(contrast: float) -> None:
    curves = {strength: taken_off(strength) for strength in (0.05, -0.05)}
    seen, near = neighbours(pair_of(1.3, 0.75, contrast), 0.75), BalanceChange(1.2, 0.8)

    for strength, tone in curves.items():
        found, kept = settle_balance_change(seen, near, tone)

        assert kept is (tone if strength == contrast else None)
        if strength == contrast or contrast == 0:
            np.testing.assert_allclose((found.red, found.blue), (1.3, 0.75), rtol=0.03)


def test_without_a_contrast_none_is_kept() -> None:
    near = BalanceChange(1.2, 0.8)

    found, kept = settle_balance_change(neighbours(pair_of(1.3, 0.75), 0.75), near, None)

    np.testing.assert_allclose((found.red, found.blue), (1.3, 0.75), rtol=0.03)
    assert kept is None


def taken_off(strength: float) -> ToneCurve:
    """The light that an S means."""
    codes = np.linspace(0.0, 1.0, 2001)
    light = np.interp(KNOTS, s_curve(strength)(codes), srgb_to_linear(codes))
    logs = np.log(np.maximum(light, 1e-6) / np.maximum(srgb_to_linear(KNOTS), 1e-6))
    logs[0] = logs[1]
    return ToneCurve(logs)
