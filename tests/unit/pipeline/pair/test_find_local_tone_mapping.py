"""Shadows of two lamps on patches of paint, each photograph mapped by its own surroundings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.images.coded_image import TableImage
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.find_local_tone_mapping import (
    _edge_aware,
    _Heights,
    find_local_tone_mapping,
)
from pipeline.pair.local_tone_mapping import LocalToneMapping
from tests.unit.pipeline.pair.shadows_on_paint import (
    SIZE,
    blocks,
    light_of,
    neighbours,
    photographs,
    s_curve,
    with_gains,
)


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


def kept_to_edges(light: Floats64, power: float, around: float) -> Floats64:
    """The same by surroundings on the same side of edges."""
    logs = np.log(light.mean(axis=2)).astype(np.float32)
    surroundings = cv2.bilateralFilter(logs, -1, 0.8, around * SIZE[0])
    return np.asarray(np.exp(power * (np.log(0.3) - surroundings))[..., None], np.float64)


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


@pytest.mark.parametrize(
    ("divide", "to_one_mean"), [(factors, False), (factors, True), (kept_to_edges, False)]
)
def test_a_mapping_is_found_whatever_its_kind(
    divide: Callable[..., Floats64], to_one_mean: bool
) -> None:
    """By smooth surroundings or by such as keep to edges, and brought to one mean or not."""
    no_flash, both = light_of()
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    beam = 0.1 + 1.8 * np.exp(-((x - 90) ** 2 + (y - 100) ** 2) / (2 * 50**2))
    both = no_flash + beam[..., None] * (both - no_flash)
    first, second = (divide(one, 0.3, 0.05) for one in (no_flash, both))
    if to_one_mean:
        second *= np.exp(np.log(first / second).mean())
    true = np.log(first / second)[..., 0]
    scale = 0.9 / max((no_flash * first).max(), (both * second).max())

    found = found_in(photographs(s_curve(0.0), (scale * no_flash * first, scale * both * second)))

    assert found is not None
    assert np.square(found.logs - true).mean() < 0.2 * np.square(true).mean()


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


@pytest.mark.parametrize(
    ("axis", "share", "told"), [(1, 0.8, True), (1, 0.7, False), (0, 0.7, False)]
)
def test_what_holds_in_one_half_of_the_picture_alone_is_not_taken(
    axis: int, share: float, told: bool
) -> None:
    """From the top or the left edge a share of the picture is mapped, the rest is not."""
    mapped_pair, plain_pair = mapped(0.3)[0], mapped(0.0)[0]
    rest = np.indices(SIZE[::-1])[axis, ..., None] >= share * SIZE[1 - axis]
    no_flash, flash = (
        np.where(rest, plain[:], one[:]).astype(np.float32)
        for one, plain in zip(mapped_pair, plain_pair, strict=True)
    )

    found = find_local_tone_mapping(blocks((no_flash, flash)), neighbours((no_flash, flash)))

    assert (found is not None) == told


@pytest.mark.parametrize("spread", [0.25, 0.5, 1.0])
def test_what_varies_more_than_edges_do_is_kept(spread: float) -> None:
    """Columns by turns above and below a mean: their variance over itself and that of edges."""
    logs = np.tile(spread * (-1.0) ** np.arange(400), (200, 1))

    around = _edge_aware(logs, 40.0)

    kept = np.std(around[50:-50, 100:-100]) / spread
    assert kept == pytest.approx(spread**2 / (spread**2 + 0.25), abs=0.02)


SURE = _Heights(mapped=14.2, plain=10.0, mapped_beyond=12.2, plain_beyond=10.0, itself=5.4)


@pytest.mark.parametrize(
    ("otherwise", "sure"),
    [
        ({}, True),
        ({"mapped": 13.8}, False),  # 1.4 times without a mapping
        ({"mapped_beyond": 11.8}, False),  # 1.2 times beyond strangers
        ({"itself": 5.8}, False),  # 2.5 times by the flash photograph itself
        ({"mapped": 1.52, "plain": 1.0, "itself": 0.5}, True),
        ({"mapped": 1.48, "plain": 1.0, "itself": 0.5}, False),  # % of the pairs
    ],
)
def test_a_mapping_must_explain_what_nothing_else_does(
    otherwise: dict[str, float], sure: bool
) -> None:
    assert replace(SURE, **otherwise).surely() == sure


@pytest.mark.parametrize(("mapped", "more"), [(11.7, True), (11.3, False)])
def test_in_each_half_a_mapping_must_explain_more(mapped: float, more: bool) -> None:
    """1.15 times as much, of whatever else."""
    half = replace(SURE, mapped=mapped, mapped_beyond=0.0, itself=10.0)

    assert half.in_part() == more
