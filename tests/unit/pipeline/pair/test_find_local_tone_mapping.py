"""Shadows of two lamps on patches of paint, each photograph mapped by its own surroundings."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.images.coded_image import TableImage
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.find_local_tone_mapping import find_local_tone_mapping
from pipeline.pair.local_tone_mapping import LocalToneMapping
from tests.unit.pipeline.pair.shadows_on_paint import (
    SIZE,
    blocks,
    light_of,
    neighbours,
    photographs,
    s_curve,
)
from tests.unit.pipeline.pair.test_find_balance_change import with_gains


def factors(light: Floats64, power: float, around: float) -> Floats64:
    """What a camera multiplies light (H, W, 3) by: its surroundings to a power, (H, W, 1)."""
    surroundings = np.log(cv2.GaussianBlur(light.mean(axis=2), (0, 0), around * SIZE[0]))
    return np.asarray(np.exp(power * (np.log(0.3) - surroundings))[..., None], np.float64)


def mapped(
    power: float,
    around: float = 0.05,
    contrast: float = 0.0,
    light: tuple[Floats64, Floats64] | None = None,
) -> tuple[tuple[TableImage, TableImage], Floats64]:
    """A pair of photographs, and by what the flash photograph must be multiplied, (H, W)."""
    no_flash, both = light_of() if light is None else light
    first, second = (factors(one, power, around) for one in (no_flash, both))
    pair = photographs(s_curve(contrast), (no_flash * first, both * second))
    return pair, np.asarray((first / second)[..., 0])


def found_in(
    pair: tuple[TableImage, TableImage], balance: BalanceChange | None = None
) -> LocalToneMapping | None:
    return find_local_tone_mapping(blocks(pair), neighbours(pair), balance)


@pytest.mark.parametrize("around", [0.03, 0.08])
@pytest.mark.parametrize("contrast", [0.0, 0.05])
def test_a_mapping_is_found(around: float, contrast: float) -> None:
    """Four fifths of its factors' variance, of surroundings that are not those looked at, too."""
    pair, true = mapped(0.3, around, contrast=contrast)

    found = found_in(pair)

    assert found is not None
    assert found.side == 1
    assert found.power == pytest.approx(0.3, abs=0.08)
    off = found.logs - np.log(true)
    assert np.square(off).mean() < 0.2 * np.square(np.log(true)).mean()


@pytest.mark.parametrize("contrast", [0.0, 0.05, 0.08])
def test_without_a_mapping_none_is_found(contrast: float) -> None:
    assert found_in(mapped(0.0, contrast=contrast)[0]) is None


def test_gains_of_the_flash_photograph_are_taken_off_first() -> None:
    gains = BalanceChange(1.25, 0.8)
    no_flash, both = (0.8 * one for one in light_of())  # not clipped by the gains
    plain, _ = mapped(0.0, light=(no_flash, with_gains(both, gains.red, gains.blue)))
    pair, _ = mapped(0.3, light=(no_flash, with_gains(both, gains.red, gains.blue)))

    assert found_in(plain, gains) is None
    assert found_in(pair, gains) is not None


def test_a_flash_photograph_that_has_one_colour_itself_tells_nothing() -> None:
    """So it has through every mapping that makes the lamps' light count for little."""
    no_flash, both = light_of()
    uneven = np.random.default_rng(0).uniform(0.97, 1.03, both.shape)
    lamps = 0.4 * no_flash.mean(axis=2, keepdims=True) * [1.0, 0.8, 0.5]
    flash = (both - no_flash).mean(axis=2, keepdims=True) * [0.9, 1.0, 1.0]
    light = lamps, np.maximum((lamps + flash) * uneven, 1.02 * lamps)

    assert found_in(mapped(0.4, light=light)[0]) is None


@pytest.mark.parametrize(("unevenness", "told"), [(0.03, True), (0.06, False)])
def test_a_peak_of_few_pairs_tells_nothing(unevenness: float, told: bool) -> None:
    """Where paints are so uneven that hardly two places have one colour."""
    no_flash, both = light_of()
    uneven = np.random.default_rng(1).standard_normal((SIZE[1] // 4, SIZE[0] // 4, 3))
    both = both * np.exp(unevenness * np.kron(uneven, np.ones((4, 4, 1))))

    found = found_in(mapped(0.3, light=(no_flash, both))[0])

    assert (found is not None) == told


@pytest.mark.parametrize(("share", "told"), [(0.8, True), (0.7, False)])
def test_what_holds_in_one_half_of_the_picture_alone_is_not_taken(share: float, told: bool) -> None:
    """From the left edge a share of the picture is mapped, the rest is not."""
    mapped_pair, plain_pair = mapped(0.3)[0], mapped(0.0)[0]
    rest = np.arange(SIZE[0])[None, :, None] >= share * SIZE[0]
    no_flash, flash = (
        np.where(rest, plain[:], one[:]).astype(np.float32)
        for one, plain in zip(mapped_pair, plain_pair, strict=True)
    )

    found = find_local_tone_mapping(blocks((no_flash, flash)), neighbours((no_flash, flash)))

    assert (found is not None) == told
