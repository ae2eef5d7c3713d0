"""Pairs of which one photograph is darker in its corners."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.images.frames import Frame
from pipeline.pair.banding import Banding
from pipeline.pair.vignetting import Vignetting
from pipeline.run_warnings import Code
from tests.unit.pipeline.pair.pairs_of_frames import have_found, paired

VIGNETTING = Vignetting(-0.25)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """Have it be found from now on; what it was looked for in."""
    return have_found(monkeypatch, "find_vignetting", VIGNETTING)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_what_was_found_is_taken_off_and_told(
    frames: Callable[..., tuple[Frame, Frame]], asked: list[tuple[Any, ...]], scale: float
) -> None:
    before, after = frames(scale=scale)
    seen = after.pixels[:].copy()

    pair = paired((before, after), exposure_ratio=scale, align=False)

    expected = VIGNETTING.off(seen / np.float32(scale))
    np.testing.assert_allclose(pair.flash[:], expected, atol=1e-6)
    np.testing.assert_array_equal(pair.no_flash[:], before.pixels[:])
    assert len(asked) == 1
    assert Code.VIGNETTING in [warning.code for warning in pair.warnings]


@pytest.mark.parametrize("flash_only", [False, True])
def test_renderings_and_flash_parts_given_alone_are_not_asked(
    frames: Callable[..., tuple[Frame, Frame]], asked: list[tuple[Any, ...]], flash_only: bool
) -> None:
    both = frames() if flash_only else frames(encoding="srgb")

    pair = paired(both, exposure_ratio=1.0, align=False, flash_only=flash_only)

    assert asked == []
    assert Code.VIGNETTING not in [warning.code for warning in pair.warnings]


def test_it_is_not_looked_for_beside_bands(
    frames: Callable[..., tuple[Frame, Frame]],
    asked: list[tuple[Any, ...]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    banding = Banding(40.0, np.array([0.0, 0.2, 0.0, 0.0]), by_columns=False)
    monkeypatch.setattr("pipeline.pair.pair.find_banding", lambda *_: banding)

    paired(frames(), exposure_ratio=1.0, align=False)

    assert asked == []
