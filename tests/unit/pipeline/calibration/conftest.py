from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.calibration import matt_sphere
from pipeline.pair.estimate_noise import estimate_noises
from pipeline.pair.pair import Pair
from tests.targets import Shot, other_colorchecker, photograph_chart, photograph_sphere
from tests.unit.pipeline.calibration.runs import DIRECTIONS, LAMP, LED, S


@pytest.fixture(scope="session")
def pair_of(pair_of: Callable[..., Pair]) -> Callable[..., Pair]:
    """Lay a shot together as if it had been taken from a tripod."""

    def build(shot: Shot, **more: Any) -> Pair:
        no_flash, flash = (frame.astype(np.float32) for frame in shot.frames)
        noises = estimate_noises(no_flash, flash)
        given: dict[str, Any] = {
            "flash": flash,
            "no_flash_noise": noises[0],
            "flash_noise": noises[1],
        }
        return replace(pair_of(no_flash, flash - no_flash), **{**given, **more})

    return build


@pytest.fixture(scope="session")
def chart() -> Shot:
    return photograph_chart(S, LED, LAMP, other_colorchecker(), noise=1.0)


@pytest.fixture(scope="module")
def ball() -> Shot:
    return photograph_sphere(DIRECTIONS[:1], np.array([(0.3, 0.2, 0.1)]))


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spheres are seen in blocks of three by three pixels, a ninth of the work."""
    monkeypatch.setattr(matt_sphere, "_BLOCKS", 1000)
