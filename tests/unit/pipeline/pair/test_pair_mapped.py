"""Pairs of which a local tone mapping is taken off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.images.frames import Exposure, Frame
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.local_tone_mapping import LocalToneMapping
from pipeline.pair.tone_curve import ToneCurve
from pipeline.run_warnings import Code
from tests.unit.pipeline.pair.pairs_of_frames import given_to, lay_as_they_are, paired

RISING = ToneCurve(np.linspace(-0.5, 0.0, 11))
CHANGE = BalanceChange(1.25, 0.8)


@pytest.fixture
def mapping(frames: Callable[..., tuple[Frame, Frame]]) -> LocalToneMapping:
    """Brighter towards the right, by blocks as small as pixels."""
    height, width = frames()[0].unusable.shape
    return LocalToneMapping(np.tile(np.linspace(0.1, 0.4, width), (height, 1)), 1, 0.25)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, mapping: LocalToneMapping) -> list[tuple[Any, ...]]:
    """What the search is given; it finds the mapping, and others find nothing."""
    monkeypatch.setattr("pipeline.pair.rendering.find_tone_curve", lambda *_: None)
    monkeypatch.setattr("pipeline.pair.rendering.find_balance_change", lambda *_: None)
    return given_to(monkeypatch, "find_local_tone_mapping", mapping)


@pytest.mark.parametrize("laid", [True, False])
def test_a_mapping_that_is_found_is_taken_off_the_flash_photograph(
    frames: Callable[..., tuple[Frame, Frame]],
    asked: list[tuple[Any, ...]],
    mapping: LocalToneMapping,
    monkeypatch: pytest.MonkeyPatch,
    laid: bool,
) -> None:
    before, after = (replace(one, encoding="srgb") for one in frames(scale=0.5))
    seen = after.pixels[:].copy()
    if laid:
        lay_as_they_are(monkeypatch)

    pair = paired((before, after), exposure_ratio=0.5, align=laid)

    assert pair.local_tone_mapping is mapping
    assert asked[0][1].ratio == 0.5
    np.testing.assert_array_equal(pair.no_flash[:], before.pixels[:])
    np.testing.assert_array_equal(after.pixels[:], seen)
    expected = seen * np.exp(mapping.logs)[..., None] / 0.5
    np.testing.assert_allclose(pair.flash[:], expected, rtol=1e-5)
    (warning,) = [one for one in pair.warnings if one.code == Code.LOCAL_TONE_MAPPING]
    assert warning.figures == mapping.entry()


def test_contrast_and_balance_are_looked_for_without_it_and_taken_off_around_it(
    frames: Callable[..., tuple[Frame, Frame]],
    asked: list[tuple[Any, ...]],
    mapping: LocalToneMapping,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A balance is asked for with it on, first, for it to be told from that."""
    given: dict[str, list[Any]] = {"balance": [], "tone": []}

    def find_balance(neighbours: Any) -> BalanceChange:
        given["balance"].append(neighbours.brightened)
        return CHANGE

    def find_tone(neighbours: Any, *_: Any) -> ToneCurve:
        given["tone"].append(neighbours.brightened)
        return RISING

    monkeypatch.setattr("pipeline.pair.rendering.find_balance_change", find_balance)
    monkeypatch.setattr("pipeline.pair.rendering.find_tone_curve", find_tone)
    monkeypatch.setattr(
        "pipeline.pair.rendering.settle_balance_change", lambda *arguments: arguments[1:]
    )
    before, after = (replace(one, encoding="srgb") for one in frames())

    pair = paired((before, after), exposure_ratio=1.0)

    there = mapping.logs.ravel()[[[0], [1]]]
    np.testing.assert_array_equal(given["balance"], [np.zeros((2, 1)), there])
    np.testing.assert_array_equal(given["tone"], [there])
    assert asked[0][2] is CHANGE
    light = RISING.light(after.pixels[:]) * np.exp(mapping.logs)[..., None]
    expected = light @ CHANGE.matrix.T.astype(np.float32)
    np.testing.assert_allclose(pair.flash[:], expected, rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(pair.no_flash[:], RISING.light(before.pixels[:]), rtol=2e-4)


@pytest.mark.parametrize(
    ("said", "flash_only"),
    [
        ({"encoding": "linear"}, False),
        ({"encoding": "raw"}, False),
        ({"encoding": "srgb"}, True),
        ({"encoding": "srgb", "exposure": Exposure()}, False),
    ],
)
def test_none_is_looked_for_in_sensor_values_or_where_exposures_are_not_known(
    frames: Callable[..., tuple[Frame, Frame]],
    asked: list[tuple[Any, ...]],
    said: dict[str, Any],
    flash_only: bool,
) -> None:
    before, after = (replace(one, **said) for one in frames())

    pair = paired((before, after), flash_only=flash_only)

    assert asked == []
    assert pair.local_tone_mapping is None
