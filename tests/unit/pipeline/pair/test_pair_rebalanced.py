"""Pairs of which a balance of white that differs is taken off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.images.frames import Exposure, Frame
from pipeline.images.noise import Noise
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.tone_curve import ToneCurve
from pipeline.run_warnings import Code
from tests.unit.pipeline.pair.pairs_of_frames import given_to, lay_as_they_are, paired

CHANGE = BalanceChange(1.25, 0.8)
RISING = ToneCurve(np.linspace(-0.5, 0.0, 11))


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What the search for a balance is given; it finds CHANGE, which stays, and no contrast."""
    monkeypatch.setattr("pipeline.pair.rendering.find_tone_curve", lambda *_: None)
    monkeypatch.setattr(
        "pipeline.pair.rendering.settle_balance_change", lambda *arguments: arguments[1:]
    )
    return given_to(monkeypatch, "find_balance_change", CHANGE)


@pytest.mark.parametrize("laid", [True, False])
def test_a_balance_that_is_found_is_taken_off_the_flash_photograph(
    frames: Callable[..., tuple[Frame, Frame]],
    asked: list[tuple[Any, ...]],
    monkeypatch: pytest.MonkeyPatch,
    laid: bool,
) -> None:
    """Also off one that was laid on the other; exposures are put on one scale after it."""
    before, after = (replace(one, encoding="srgb") for one in frames(scale=0.5))
    seen = after.pixels[:].copy()
    if laid:
        lay_as_they_are(monkeypatch)

    pair = paired((before, after), exposure_ratio=0.5, align=laid)

    assert pair.balance_change is CHANGE
    assert asked[0][0].ratio == 0.5
    np.testing.assert_array_equal(pair.no_flash[:], before.pixels[:])
    np.testing.assert_array_equal(after.pixels[:], seen)
    expected = seen @ CHANGE.matrix.T.astype(np.float32) / 0.5
    np.testing.assert_allclose(pair.flash[:], expected, atol=1e-6)
    assert [one.code for one in pair.warnings].count(Code.AUTO_WHITE_BALANCE) == 1


def test_compression_noise_of_the_flash_photograph_goes_along(
    frames: Callable[..., tuple[Frame, Frame]], asked: list[tuple[Any, ...]]
) -> None:
    noise = Noise(np.full(3, 1e-3), np.full(3, 1e-3))
    before, after = (replace(one, encoding="srgb") for one in frames())

    plain = paired((before, after), exposure_ratio=1.0)
    pair = paired((before, replace(after, compression=noise)), exposure_ratio=1.0)

    assert len(asked) == 2
    added = pair.flash_noise.floor - plain.flash_noise.floor
    np.testing.assert_allclose(added, CHANGE.noise(noise).floor, rtol=1e-6)


def test_a_contrast_is_looked_for_with_the_balance_and_taken_off_before_it(
    frames: Callable[..., tuple[Frame, Frame]],
    asked: list[tuple[Any, ...]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before, after = (replace(one, encoding="srgb") for one in frames())
    given: list[Any] = []

    def find(*arguments: Any) -> ToneCurve:
        given.append(arguments[1])
        return RISING

    monkeypatch.setattr("pipeline.pair.rendering.find_tone_curve", find)

    pair = paired((before, after), exposure_ratio=1.0)

    assert len(asked) == 1
    assert given[0] is CHANGE
    assert (pair.balance_change, pair.tone_curve) == (CHANGE, RISING)
    expected = RISING.light(after.pixels[:]) @ CHANGE.matrix.T.astype(np.float32)
    np.testing.assert_allclose(pair.flash[:], expected, rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(pair.no_flash[:], RISING.light(before.pixels[:]), rtol=2e-4)


@pytest.mark.parametrize(
    ("said", "flash_only"),
    [
        ({"encoding": "linear"}, False),
        ({"encoding": "raw"}, False),
        ({"encoding": "srgb"}, True),
        ({"encoding": "srgb", "auto_white_balance": False}, False),
        ({"encoding": "srgb", "exposure": Exposure()}, False),
    ],
)
def test_nothing_is_looked_for_where_balances_are_equal_or_exposures_are_not_known(
    frames: Callable[..., tuple[Frame, Frame]],
    asked: list[tuple[Any, ...]],
    said: dict[str, Any],
    flash_only: bool,
) -> None:
    before, after = (replace(one, **said) for one in frames())

    pair = paired((before, after), flash_only=flash_only)

    assert asked == []
    assert pair.balance_change is None


@pytest.mark.parametrize("which", [0, 1])
def test_it_is_looked_for_where_one_alone_was_balanced_by_itself(
    frames: Callable[..., tuple[Frame, Frame]], asked: list[tuple[Any, ...]], which: int
) -> None:
    both = [replace(one, encoding="srgb", auto_white_balance=False) for one in frames()]
    both[which] = replace(both[which], auto_white_balance=True)

    paired((both[0], both[1]), exposure_ratio=1.0)

    assert len(asked) == 1
