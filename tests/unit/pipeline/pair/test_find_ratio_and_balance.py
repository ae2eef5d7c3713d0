"""Shadows of two lamps on patches of paint, the flash photograph exposed and balanced otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.pair.find_ratio_and_balance import find_ratio_and_balance
from pipeline.pair.one_surface import PairBlocks
from tests.unit.pipeline.pair.shadows_on_paint import (
    blocks,
    light_of,
    pair_of,
    photographs,
    s_curve,
)

GAINS = [(1.2, 0.8), (0.85, 1.1)]


def taken(red: float, blue: float, exposure: float, contrast: float = 0.0) -> PairBlocks:
    return blocks(pair_of(red, blue, contrast, exposure))


@pytest.mark.parametrize("exposure", [0.5, 0.75])
@pytest.mark.parametrize("gains", GAINS)
def test_a_shorter_exposure_and_another_balance_are_told_together(
    gains: tuple[float, float], exposure: float
) -> None:
    found = find_ratio_and_balance(taken(*gains, exposure), None)

    assert found is not None
    ratio, balance = found
    assert ratio == pytest.approx(exposure, rel=0.05)
    np.testing.assert_allclose((balance.red, balance.blue), gains, rtol=0.05)


def test_through_a_contrast_they_are_about() -> None:
    found = find_ratio_and_balance(taken(1.2, 0.8, 0.6, contrast=0.05), None)

    assert found is not None
    ratio, balance = found
    assert ratio == pytest.approx(0.6, rel=0.15)
    np.testing.assert_allclose((balance.red, balance.blue), (1.2, 0.8), rtol=0.05)


@pytest.mark.parametrize("contrast", [0.0, 0.05])
@pytest.mark.parametrize("gains", GAINS)
def test_of_equal_exposures_the_balance_alone_is_told(
    gains: tuple[float, float], contrast: float
) -> None:
    found = find_ratio_and_balance(taken(*gains, 1.0, contrast), None)

    assert found is not None
    ratio, balance = found
    assert ratio == 1.0
    np.testing.assert_allclose((balance.red, balance.blue), gains, rtol=0.04)


@pytest.mark.parametrize("contrast", [0.0, 0.08])
@pytest.mark.parametrize("gains", [(1.0, 1.0), (1.03, 0.97)])
def test_of_pairs_that_are_alike_nothing_is_told(
    gains: tuple[float, float], contrast: float
) -> None:
    assert find_ratio_and_balance(taken(*gains, 1.0, contrast), None) is None


@pytest.mark.parametrize("exposure", [0.5, 0.7])
def test_a_ratio_that_explains_the_pair_alone_is_left_alone(exposure: float) -> None:
    assert find_ratio_and_balance(taken(1.0, 1.0, exposure), exposure) is None


def test_a_ratio_found_that_gains_do_without_is_told_anew() -> None:
    found = find_ratio_and_balance(taken(1.2, 0.8, 0.6), 0.8)

    assert found is not None
    assert found[0] == pytest.approx(0.6, rel=0.05)


def test_an_even_share_of_the_lamps_tells_nothing() -> None:
    lamps, _ = light_of("none")

    found = blocks(photographs(s_curve(0.0), (lamps, 0.6 * 1.8 * lamps)))

    assert find_ratio_and_balance(found, None) is None


def test_few_blocks_tell_nothing() -> None:
    pair = taken(1.2, 0.8, 0.6)
    known = np.zeros_like(pair.known)
    known[60:64, 100:104] = True

    assert find_ratio_and_balance(replace(pair, known=known), None) is None
