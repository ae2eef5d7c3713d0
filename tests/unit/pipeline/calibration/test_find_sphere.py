from __future__ import annotations

import numpy as np
import pytest

from pipeline.calibration.find_sphere import _refined, find_spheres
from pipeline.calibration.marks import disc
from pipeline.calibration.sphere import sphere_outline
from pipeline.options import Circle
from tests.cluttered import FOCAL_PX, Room, photograph_room

FLAT = 1e6
"""Focal length in pixels by which outlines are circles."""


def _lights(room: Room) -> tuple[np.ndarray, np.ndarray]:
    return np.maximum(room.frames[0], 0), np.maximum(room.frames[1] - room.frames[0], 0)


@pytest.mark.parametrize("mirror", [False, True])
def test_the_outline_of_a_sphere_is_found(mirror: bool) -> None:
    room = photograph_room("mirror" if mirror else "matt", 1)
    (found,) = find_spheres(*_lights(room), mirror, FOCAL_PX)
    true = room.circle
    assert true is not None
    for name in ("x", "y", "radius"):
        assert abs(getattr(found, name) - getattr(true, name)) < 0.01 * true.radius


@pytest.mark.parametrize("mirror", [False, True])
def test_a_room_without_a_sphere_has_none(mirror: bool) -> None:
    assert find_spheres(*_lights(photograph_room("none", 2)), mirror, FOCAL_PX) == []


def test_a_matt_sphere_is_no_mirror() -> None:
    assert find_spheres(*_lights(photograph_room("matt", 3)), True, FOCAL_PX) == []


def _disc() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns (H, W), distances from a middle by a radius, and 1 inside of it, 0 outside."""
    v, u = np.mgrid[:300, :400] + 0.5
    away = np.hypot(u - 180, v - 140) / 80
    return u, away, np.clip((1 - away) * 80 + 0.5, 0, 1)[..., None]


@pytest.mark.parametrize(("tint", "found"), [(0.0, 1), (0.4, 0)])
def test_a_sphere_of_two_colours_is_none(tint: float, found: int) -> None:
    """Red on the left, green on the right, and everywhere as bright as a matt one."""
    u, away, inside = _disc()
    paint = np.where((u < 180)[..., None], [1 + tint, 1 - tint, 1], [1 - tint, 1 + tint, 1])
    shade = 0.5 * np.sqrt(np.maximum(1 - away**2, 0))[..., None] * paint
    noise = np.random.default_rng(1).normal(0, 0.002, (2, *paint.shape))
    flash = inside * shade + 0.3 * (1 - inside)
    lamps = np.full_like(flash, 0.2) + 0.1 * (1 - inside)
    assert len(find_spheres(lamps + noise[0], flash + noise[1], False, FLAT)) == found


@pytest.mark.parametrize(("size", "found"), [(0.1, 1), (0.2, 1), (0.22, 0)])
def test_a_mirror_shows_the_flash_small(size: float, found: int) -> None:
    """By the radius of the sphere: what fills a twentieth of it is something bright before it."""
    _, away, inside = _disc()
    spot = 3.0 * (away < size)[..., None] * np.ones(3)
    noise = np.random.default_rng(1).normal(0, 0.002, (2, *spot.shape))
    flash = np.maximum(inside * (0.02 + spot) + 0.3 * (1 - inside) + noise[0], 0)
    lamps = np.full_like(flash, 0.1) + 0.2 * (1 - inside)
    assert len(find_spheres(lamps + noise[1], flash, True, FLAT)) == found


@pytest.mark.parametrize("margin", [0, 1, 2, 3, 6])
@pytest.mark.parametrize("side", ["left", "right", "upper", "lower", "corner"])
def test_a_matt_sphere_near_the_edge_is_found_inside_the_picture(margin: int, side: str) -> None:
    """With so many pixels between them; the outline is one that can be read at once."""
    radius, (height, width) = 80.0, (300, 400)
    near = radius + margin
    x, y = {
        "left": (near, 140.0),
        "right": (width - near, 140.0),
        "upper": (180.0, near),
        "lower": (180.0, height - near),
        "corner": (near, near),
    }[side]
    v, u = np.mgrid[:height, :width] + 0.5
    away = np.hypot(u - x, v - y) / radius
    inside = np.clip((1 - away) * radius + 0.5, 0, 1)
    shade = inside * 0.5 * np.sqrt(np.maximum(1 - away**2, 0))
    flash = np.repeat((shade + 0.3 * (1 - inside))[..., None], 3, axis=2)
    lamps = np.repeat((inside * 0.2 + 0.3 * (1 - inside))[..., None], 3, axis=2)
    noise = np.random.default_rng(1).normal(0, 0.002, (2, height, width, 3))

    (found,) = find_spheres(lamps + noise[0], flash + noise[1], False, FLAT)

    assert (found.x, found.y, found.radius) == pytest.approx((x, y, radius), abs=1.0)
    read = disc((height, width), found, "sphere")
    assert read.sum() == pytest.approx(np.pi * radius**2, rel=0.03)


@pytest.mark.parametrize(("x", "y"), [(200.0, 150.0), (290.0, 90.0), (335.0, 235.0)])
@pytest.mark.parametrize("focal_px", [250.0, 2000.0])
def test_the_outline_of_a_sphere_beside_the_axis_is_an_ellipse(
    x: float, y: float, focal_px: float
) -> None:
    """Whose semi-axes differ by a fifth in the corner of a wide-angle lens.

    x, y: where the middle of a sphere is seen.
    """
    height, width = 300, 400
    v, u = np.mgrid[:height, :width] + 0.5
    rays = np.stack([(u - 200) / focal_px, (150 - v) / focal_px, -np.ones_like(u)], axis=2)
    axis = np.array([(x - 200) / focal_px, (150 - y) / focal_px, -1])
    cosine = rays @ axis / np.linalg.norm(rays, axis=2) / np.linalg.norm(axis)
    half_angle = 40 / focal_px / (axis @ axis)
    inside = np.clip((half_angle - np.arccos(np.minimum(cosine, 1))) * focal_px + 0.5, 0, 1)
    light = np.repeat((0.2 + 0.6 * inside)[..., None], 3, axis=2).astype(np.float32)
    true = sphere_outline((x, y), half_angle, focal_px, (width, height))

    marked = Circle(x=true.x + 1, y=true.y - 1, radius=true.radius)
    found = _refined(light, marked, focal_px)

    assert (found.x, found.y, found.radius) == pytest.approx(
        (true.x, true.y, true.radius), abs=0.25
    )


@pytest.mark.parametrize("x", [32_745.2, 32_850.3, 32_968.4])
def test_an_outline_is_refined_in_pictures_of_any_size(x: float) -> None:
    """Of a sphere in the middle and at both ends of a strip, as of the strip alone.

    But for what cv2.remap rounds places to, a thirty-second of a pixel.
    """
    v, u = np.mgrid[:100, 32_700:33_000] + 0.5
    disc = 1 / (1 + np.exp(np.hypot(u - x, v - 51) - 40))
    strip = np.repeat(disc[..., None], 3, axis=2).astype(np.float32)
    wide = np.concatenate([np.full((100, 32_700, 3), 0.5, np.float32), strip], axis=1)

    found = _refined(wide, Circle(x=x + 1, y=50, radius=41), FLAT)
    alone = _refined(strip, Circle(x=x + 1 - 32_700, y=50, radius=41), FLAT)

    assert (found.x - 32_700, found.y, found.radius) == pytest.approx(
        (alone.x, alone.y, alone.radius), abs=0.01
    )
    assert (found.x, found.y, found.radius) == pytest.approx((x, 51, 40), abs=0.5)
