"""Shadows of two lamps on patches of paint, the flash photograph exposed shorter by the camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.pair.find_rendered_ratio import find_rendered_ratio
from pipeline.pair.one_surface import PairBlocks
from tests.unit.pipeline.pair.shadows_on_paint import (
    blocks,
    light_of,
    pair_of,
    photographs,
    s_curve,
)


def exposed(exposure: float, contrast: float = 0.0, flash: float = 0.35) -> PairBlocks:
    """A pair whose flash photograph was exposed so many times as long."""
    no_flash, both = light_of(flash=flash)
    return blocks(photographs(s_curve(contrast), (no_flash, exposure * both)))


@pytest.mark.parametrize("exposure", [0.35, 0.5, 0.7, 0.85])
def test_a_shorter_exposure_is_told(exposure: float) -> None:
    assert find_rendered_ratio(exposed(exposure)) == pytest.approx(exposure, rel=0.01)


@pytest.mark.parametrize("exposure", [0.35, 0.5, 0.7])
def test_it_is_told_about_through_a_contrast(exposure: float) -> None:
    found = find_rendered_ratio(exposed(exposure, contrast=0.05))

    assert found == pytest.approx(exposure, rel=0.15)


@pytest.mark.parametrize("contrast", [0.0, 0.05, 0.08])
@pytest.mark.parametrize("exposure", [0.97, 1.0, 1.3])
def test_equal_and_longer_exposures_are_not(exposure: float, contrast: float) -> None:
    assert find_rendered_ratio(exposed(exposure, contrast)) is None


@pytest.mark.parametrize("gains", [(1.3, 0.75), (0.75, 1.3)])
def test_another_balance_is_not_taken_for_a_shorter_exposure(gains: tuple[float, float]) -> None:
    assert find_rendered_ratio(blocks(pair_of(*gains, exposure=1.0))) is None


@pytest.mark.parametrize("exposure", [0.5, 1.0])
def test_an_even_share_of_the_lamps_tells_nothing(exposure: float) -> None:
    lamps, _ = light_of("none")

    found = blocks(photographs(s_curve(0.0), (lamps, exposure * 1.8 * lamps)))

    assert find_rendered_ratio(found) is None


def test_blocks_that_cannot_be_used_do_not_count() -> None:
    """In the right half the flash photograph shows something else."""
    pair = exposed(0.5)
    half = pair.known.shape[1] // 2
    srgb, known = pair.srgb.copy(), pair.known.copy()
    srgb[1, :, half:] = np.roll(srgb[1, :, half:], 17, axis=0)
    known[:, half:] = False

    found = find_rendered_ratio(replace(pair, srgb=srgb, known=known))

    assert found == pytest.approx(0.5, rel=0.04)


def test_few_blocks_tell_nothing() -> None:
    pair = exposed(0.5)
    known = np.zeros_like(pair.known)

    assert find_rendered_ratio(replace(pair, known=known)) is None
    known[60:80, 100:120] = True
    assert find_rendered_ratio(replace(pair, known=known)) is None
