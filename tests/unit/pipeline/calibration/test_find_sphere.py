from __future__ import annotations

import numpy as np
import pytest

from pipeline.calibration.find_sphere import _refined, find_spheres
from pipeline.options import Circle
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


@pytest.mark.parametrize("x", [32_745.2, 32_850.3, 32_968.4])
def test_an_outline_is_refined_in_pictures_of_any_size(x: float) -> None:
    """Of a sphere in the middle and at both ends of a strip, as of the strip alone.

    But for what cv2.remap rounds places to, a thirty-second of a pixel.
    """
    v, u = np.mgrid[:100, 32_700:33_000] + 0.5
    disc = 1 / (1 + np.exp(np.hypot(u - x, v - 51) - 40))
    strip = np.repeat(disc[..., None], 3, axis=2).astype(np.float32)
    wide = np.concatenate([np.full((100, 32_700, 3), 0.5, np.float32), strip], axis=1)

    found = _refined(wide, Circle(x=x + 1, y=50, radius=41))
    alone = _refined(strip, Circle(x=x + 1 - 32_700, y=50, radius=41))

    assert (found.x - 32_700, found.y, found.radius) == pytest.approx(
        (alone.x, alone.y, alone.radius), abs=0.01
    )
    assert (found.x, found.y, found.radius) == pytest.approx((x, 51, 40), abs=0.5)
