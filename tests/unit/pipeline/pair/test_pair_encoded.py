"""Pairs of values that were read as linear and follow a curve."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.colour.curves import linear_to_srgb
from pipeline.images.frames import Exposure, Frame
from pipeline.run_warnings import Code
from tests.unit.pipeline.pair.pairs_of_frames import have_found, paired
from tests.unit.pipeline.pair.shadows_on_paint import light_of


def _shadows(frame: Callable[..., Frame], encoded: bool, **more: Any) -> tuple[Frame, Frame]:
    """Shadows on paint, through sRGB's curve or not; of a camera that wrote no exposure."""
    random = np.random.default_rng(1)
    values = [light + random.normal(0, 0.002, light.shape) for light in light_of()]
    if encoded:
        values = [linear_to_srgb(np.clip(one, 0.0, 1.0)).astype(np.float64) for one in values]
    return frame(values[0], **more), frame(values[1], **more)


@pytest.mark.parametrize("exposure", [Exposure(), Exposure(time_s=1 / 60)])
def test_encoded_values_are_told_and_nothing_that_follows_from_them(
    frame: Callable[..., Frame], exposure: Exposure
) -> None:
    pair = paired(_shadows(frame, True, exposure=exposure), align=False)

    assert [warning.code for warning in pair.warnings] == [Code.ENCODING_DOUBTFUL]
    assert "Pass the encoding srgb" in pair.warnings[0].message
    assert pair.exposure_ratio == 1.0


def test_linear_values_are_not(frame: Callable[..., Frame]) -> None:
    pair = paired(_shadows(frame, False), align=False)

    assert Code.ENCODING_DOUBTFUL not in [warning.code for warning in pair.warnings]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What is asked for an encoding from now on, which is found."""
    return have_found(monkeypatch, "looks_encoded", True)


@pytest.mark.parametrize(
    "declared",
    [{"encoding": "raw"}, {"encoding": "srgb"}, {"encoding": "linear", "profiled": True}],
)
def test_files_that_say_what_they_hold_are_not_asked(
    frames: Callable[..., tuple[Frame, Frame]],
    asked: list[tuple[Any, ...]],
    declared: dict[str, Any],
) -> None:
    pair = paired(frames(**declared), exposure_ratio=1.0, align=False)

    assert asked == []
    assert Code.ENCODING_DOUBTFUL not in [warning.code for warning in pair.warnings]


def test_the_ratio_that_was_told_goes_along(
    frames: Callable[..., tuple[Frame, Frame]], asked: list[tuple[Any, ...]]
) -> None:
    pair = paired(frames(scale=0.5), exposure_ratio=0.5, align=False)

    assert [arguments[1] for arguments in asked] == [0.5]
    assert Code.ENCODING_DOUBTFUL in [warning.code for warning in pair.warnings]
