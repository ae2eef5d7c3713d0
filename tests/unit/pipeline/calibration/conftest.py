from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.align import NOT_ATTEMPTED
from pipeline.noise import estimate_noise
from pipeline.pair import Pair
from tests.targets import Shot


@pytest.fixture(scope="session")
def pair_of() -> Callable[..., Pair]:
    """Lay a shot together as if it had been taken from a tripod."""

    def build(shot: Shot, **more: Any) -> Pair:
        no_flash, flash = (frame.astype(np.float32) for frame in shot.frames)
        given: dict[str, Any] = {
            "no_flash": no_flash,
            "flash": flash,
            "unusable": np.zeros(no_flash.shape[:2], bool),
            "flash_only": False,
            "exposure_ratio": 1.0,
            "exposure_source": "option",
            "rendered": False,
            "no_flash_noise": estimate_noise(no_flash),
            "flash_noise": estimate_noise(flash),
            "alignment": NOT_ATTEMPTED,
            "registration": 0.0,
            "parallax": 0.0,
            "moved": 0.0,
            "clipped": 0.0,
            "warnings": (),
        }
        return Pair(**{**given, **more})

    return build
