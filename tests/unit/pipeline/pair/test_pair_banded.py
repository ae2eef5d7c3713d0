"""Pairs under lamps that flicker with the mains."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.images.frames import Frame
from pipeline.pair.banding import Banding
from pipeline.run_warnings import Code
from tests.unit.pipeline.pair.pairs_of_frames import have_found, paired

BANDING = Banding(40.0, np.array([0.0, 0.2, 0.0, 0.0]), by_columns=False)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """Have bands be found from now on; what they were looked for in."""
    return have_found(monkeypatch, "find_banding", BANDING)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_bands_that_were_found_are_taken_off_and_told(
    frames: Callable[..., tuple[Frame, Frame]], asked: list[tuple[Any, ...]], scale: float
) -> None:
    before, after = frames(scale=scale)
    seen = after.pixels[:].copy()

    pair = paired((before, after), exposure_ratio=scale, align=False)

    expected = BANDING.off(before.pixels[:], seen / np.float32(scale))
    np.testing.assert_allclose(pair.flash[:], expected, atol=1e-6)
    np.testing.assert_array_equal(pair.no_flash[:], before.pixels[:])
    assert len(asked) == 1
    assert Code.FLICKER in [warning.code for warning in pair.warnings]


@pytest.mark.parametrize("flash_only", [False, True])
def test_renderings_and_flash_parts_given_alone_are_not_asked(
    frames: Callable[..., tuple[Frame, Frame]], asked: list[tuple[Any, ...]], flash_only: bool
) -> None:
    both = frames() if flash_only else frames(encoding="srgb")

    pair = paired(both, exposure_ratio=1.0, align=False, flash_only=flash_only)

    assert asked == []
    assert Code.FLICKER not in [warning.code for warning in pair.warnings]
