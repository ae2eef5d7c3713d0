from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats32
from pipeline.photometric_stereo.confidence import normals_confidence
from pipeline.photometric_stereo.solve import Surface
from pipeline.separation.separation import Strip

SIZE = 8
UP = np.broadcast_to(np.array([0, 0, 1], np.float32), (SIZE, SIZE, 3))


def surface(**more: Any) -> Surface:
    """Known everywhere, and nothing against it."""
    shape = (SIZE, SIZE)
    given: dict[str, Any] = {
        "block": 1,
        "mask": np.ones(shape, bool),
        "cut": np.zeros(shape, bool),
        "w": np.ones((*shape, 3)),
        "z": np.ones(shape),
        "lit": np.ones((*shape, 3)),
        "deviations": np.zeros((*shape, 3, 3)),
        "correction": np.ones((*shape, 3)),
        "directions": np.eye(3),
        "matrices": np.ones((3, 3, 3)),
        "misfit": 0.0,
        "unexplained": 0.0,
        "strengths": np.ones(3),
        "turned_deg": 0.0,
        "focal_px": 10.0,
    }
    return Surface(**{**given, **more})


def trust(confidence: float = 1.0, normals: Any = UP, **more: Any) -> Floats32:
    light = np.ones((SIZE, SIZE, 3), np.float32)
    sure = np.full((SIZE, SIZE), confidence, np.float32)
    strip = Strip(slice(0, SIZE), light[None], light, light, sure)
    return normals_confidence(strip, surface(**more), normals)


FULL = 1 / 1.09


@pytest.mark.parametrize(("first", "expected"), [(0, 0.5), (8, 1.0)])
def test_trust_is_that_of_the_strips_rows(first: int, expected: float) -> None:
    """Blocks of two pixels, the upper half of which fit half as well as they might."""
    off = np.ones((SIZE, SIZE, 3))
    off[:3] = 1.02
    light = np.ones((4, 2 * SIZE, 3), np.float32)
    rows = slice(first, first + 4)
    strip = Strip(rows, light[None], light, light, np.ones((4, 2 * SIZE), np.float32))
    up = np.broadcast_to(np.array([0, 0, 1], np.float32), light.shape)

    found = normals_confidence(strip, surface(block=2, correction=off), up)

    assert found.shape == (4, 2 * SIZE)
    np.testing.assert_allclose(found, expected * FULL, rtol=1e-5)


def test_nothing_against_it_is_trust() -> None:
    np.testing.assert_allclose(trust(), FULL, rtol=1e-5)


@pytest.mark.parametrize(
    ("given", "share"),
    [
        ({"confidence": 0.5}, 0.5),
        ({"lit": np.broadcast_to([1.0, 0, 1], (SIZE, SIZE, 3))}, 0.75),
        ({"lit": np.zeros((SIZE, SIZE, 3))}, 0.25),
        ({"correction": np.broadcast_to([1.0, 1.02, 1], (SIZE, SIZE, 3))}, 0.5),
        ({"correction": np.broadcast_to([0.98, 1.0, 1], (SIZE, SIZE, 3))}, 0.5),
        ({"cut": np.ones((SIZE, SIZE), bool)}, 0.2),
        ({"mask": np.zeros((SIZE, SIZE), bool)}, 0.0),
        ({"normals": np.array([0.954, 0, 0.3], np.float32) * np.ones_like(UP)}, 0.545),
        ({"normals": np.array([0.6, 0, -0.8], np.float32) * np.ones_like(UP)}, 0.0),
        ({"normals": np.full_like(UP, np.nan)}, 0.0),
    ],
)
def test_each_doubt_takes_its_share(given: dict[str, Any], share: float) -> None:
    np.testing.assert_allclose(trust(**given), share * FULL, atol=1e-3)
