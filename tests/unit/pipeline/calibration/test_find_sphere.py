from __future__ import annotations

import numpy as np
import pytest

from pipeline.calibration.find_sphere import find_spheres
from tests.cluttered import Room, photograph_room


def _lights(room: Room) -> tuple[np.ndarray, np.ndarray]:
    return np.maximum(room.frames[0], 0), np.maximum(room.frames[1] - room.frames[0], 0)


@pytest.mark.parametrize("mirror", [False, True])
def test_the_outline_of_a_sphere_is_found(mirror: bool) -> None:
    room = photograph_room("mirror" if mirror else "matt", 1)
    (found,) = find_spheres(*_lights(room), mirror)
    true = room.circle
    assert true is not None
    for name in ("x", "y", "radius"):
        assert abs(getattr(found, name) - getattr(true, name)) < 0.04 * true.radius


@pytest.mark.parametrize("mirror", [False, True])
def test_a_room_without_a_sphere_has_none(mirror: bool) -> None:
    assert find_spheres(*_lights(photograph_room("none", 2)), mirror) == []


def test_a_matt_sphere_is_no_mirror() -> None:
    assert find_spheres(*_lights(photograph_room("matt", 3)), True) == []
