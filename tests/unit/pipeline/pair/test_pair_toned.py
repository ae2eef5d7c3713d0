"""Pairs of which a camera's contrast is taken off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.images.frames import Frame
from pipeline.pair.tone_curve import ToneCurve
from tests.unit.pipeline.pair.pairs_of_frames import given_to, lay_as_they_are, paired

RISING = ToneCurve(np.linspace(-0.5, 0.0, 11))


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What the search for a contrast is given; it finds RISING."""
    return given_to(monkeypatch, "find_tone_curve", RISING)


@pytest.mark.parametrize("laid", [True, False])
def test_a_contrast_that_is_found_is_taken_off_both_photographs(
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

    assert pair.tone_curve is RISING
    np.testing.assert_allclose(pair.no_flash[:], RISING.light(before.pixels[:]), rtol=2e-4)
    np.testing.assert_allclose(pair.flash[:], RISING.light(seen) / 0.5, rtol=2e-4)
    np.testing.assert_array_equal(after.pixels[:], seen)
    assert asked[0][0].ratio == 0.5


@pytest.mark.parametrize(
    ("encoding", "flash_only"), [("linear", False), ("raw", False), ("srgb", True)]
)
def test_a_contrast_is_looked_for_in_renderings_with_the_lamps_light_alone(
    frames: Callable[..., tuple[Frame, Frame]],
    asked: list[tuple[Any, ...]],
    encoding: str,
    flash_only: bool,
) -> None:
    before, after = (replace(one, encoding=encoding) for one in frames())

    pair = paired((before, after), flash_only=flash_only)

    assert asked == []
    assert pair.tone_curve is None
    np.testing.assert_array_equal(pair.no_flash[:], before.pixels[:])
