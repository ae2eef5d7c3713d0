from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.sim.render import Renderer
from drivers.sim.scene import Scene
from pipeline.arrays import Floats32, Floats64

BALL = {"kind": "sphere", "materials": ["a"], "centre": [0, 0, 0], "half": [0.5, 0.5, 0.5]}
FLOOR = {"kind": "box", "materials": ["b"], "centre": [0, -1, 0], "half": [9, 0.1, 9]}


def scene(
    *shapes: Mapping[str, object],
    direction: tuple[float, ...] = (0, 1, 0),
    radius_deg: float = 0,
    position: tuple[float, ...] = (0, 0, 4),
) -> Scene:
    return Scene.model_validate(
        {
            "version": 1,
            "view": {"position": position, "look_at": [0, 0, 0], "focal_35mm": 50},
            "highlight": 0.9,
            "flash": 1.0,
            "lamps": [
                {
                    "name": "lamp",
                    "light": "Incandescent",
                    "direction": direction,
                    "strength": 1,
                    "radius_deg": radius_deg,
                }
            ],
            "materials": {"a": "chart/red", "b": "chart/green"},
            "shapes": list(shapes),
        }
    )


GREY = np.ones((2, 2, 1))


def rendered(
    what: Scene, width: int = 96, height: int = 64, colours: Floats64 = GREY
) -> tuple[Floats32, Floats32]:
    return Renderer(what, 1, width, height).block(slice(0, height), colours)


def test_a_ball_is_shaded_by_the_cosine() -> None:
    to_lamp = np.array([0.6, 0.0, 0.8])
    light, normals = rendered(scene(BALL, direction=tuple(to_lamp)), 288, 192)
    seen = np.isfinite(normals[..., 0])
    assert 0.05 < seen.mean() < 0.3
    inner = seen & (normals[..., 2] > 0.5)  # away from the rim, which the low-pass filter blurs
    cosine = np.maximum(normals @ to_lamp, 0)
    assert np.abs(light[0, ..., 0] - cosine)[inner].max() < 0.02
    assert (light[:, ~seen & far_from(seen)] == 0).all()


def test_a_mirror_shows_the_lamp_where_it_is_reflected_and_is_dark_elsewhere() -> None:
    ball = {**BALL, "mirror": 0.04}
    to_lamp = np.array([0.6, 0.0, 0.8])
    what = scene(ball, direction=tuple(to_lamp), radius_deg=15)
    light, normals = rendered(what, 288, 192)
    seen = np.isfinite(normals[..., 0])
    rows, columns = np.nonzero(light[0, ..., 0] > 0.3)
    # the surface faces half-way between the camera, which is in front, and the lamp
    facing = normals[rows, columns].astype(np.float64).mean(axis=0)
    half_way = (to_lamp + np.array([0, 0, 1])) / np.sqrt(3.6)
    assert np.degrees(np.arccos(facing @ half_way / np.linalg.norm(facing))) < 3
    # a lamp of 15° that gives 1 on a card is 1/sin² 15° as bright
    brightest = 0.04 / np.sin(np.radians(15)) ** 2
    assert light[0].max() == pytest.approx(brightest, rel=1e-3)
    dark = seen & (normals @ half_way < np.cos(np.radians(15)))
    assert light[0, dark, 0].max() == 0


def test_a_mirror_shows_the_flash_in_its_middle() -> None:
    light, normals = rendered(scene({**BALL, "mirror": 1.0}), 385, 257)
    assert light[1, 128, 192, 0] == pytest.approx(1 / np.sin(np.radians(6)) ** 2, rel=1e-3)
    assert light[1, normals[..., 2] < 0.95].max() == 0


def far_from(seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask pixels more than two away from any surface."""
    grown = seen.copy()
    for _ in range(3):
        padded = np.pad(grown, 1)
        grown = padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:] | grown
    return ~grown


def test_normals_are_unit_and_in_the_cameras_axes() -> None:
    _, normals = rendered(scene(BALL), 97, 65)
    seen = np.isfinite(normals[..., 0])
    assert np.allclose(np.linalg.norm(normals[seen], axis=1), 1, atol=1e-6)
    assert np.allclose(normals[32, 48], [0, 0, 1], atol=1e-6)  # the middle faces the camera
    assert normals[32, 52, 0] > 0.2  # right of it they point right
    assert normals[28, 48, 1] > 0.2  # above it, up


def test_normals_turn_with_the_camera() -> None:
    _, normals = rendered(scene(FLOOR, position=(0, 3, 3)), 96, 64)
    assert np.allclose(normals[60, 48], [0, 0.5**0.5, 0.5**0.5], atol=1e-6)  # seen at 45°


def test_the_flash_casts_no_shadow_and_falls_off() -> None:
    near = {**BALL, "centre": [-0.7, 0, 1.0]}
    far = {**BALL, "centre": [0.7, 0, -1.0]}
    light, _ = rendered(scene(near, far), 192, 128)
    flash = light[-1, ..., 0]
    brightest_near, brightest_far = flash[:, :96].max(), flash[:, 96:].max()
    near_m = np.hypot(0.7, 3) - 0.5
    far_m = np.hypot(0.7, 5) - 0.5
    assert brightest_near == pytest.approx((4 / near_m) ** 2, rel=0.02)
    assert brightest_far == pytest.approx((4 / far_m) ** 2, rel=0.02)
    floor_only, _ = rendered(scene(FLOOR), 192, 128)
    with_ball, normals = rendered(scene(FLOOR, BALL), 192, 128)
    floor = normals[..., 1] > 0.999
    same = np.abs(floor_only[-1, ..., 0] - with_ball[-1, ..., 0]) < 1e-3
    assert same[floor & ~near_edge(normals)].all()


def near_edge(normals: Floats32) -> NDArray[np.bool_]:
    """Mask pixels within two of a change of normals."""
    key = np.nan_to_num(normals, nan=-9).round(3)
    edge = np.zeros(key.shape[:2], bool)
    for axis in (0, 1):
        for step in (1, 2):
            differs = np.abs(key - np.roll(key, step, axis)).max(-1) > 0.01
            edge |= differs | np.roll(differs, -step, axis)
    return edge


def test_shadows_fall_where_the_lamp_is_hidden() -> None:
    light, normals = rendered(scene(FLOOR, BALL, direction=(0, 1, 0)), 192, 128)
    floor = (normals[..., 1] > 0.999) & ~near_edge(normals)
    lamp = light[0, ..., 0][floor]
    dark, full = lamp < 1e-6, np.abs(lamp - 1) < 1e-6
    assert (dark | full).mean() > 0.9  # a point-like lamp has hard shadows
    assert dark.sum() > 50
    open_floor, _ = rendered(scene(FLOOR, direction=(0, 1, 0)), 192, 128)
    assert np.abs(open_floor[0, ..., 0][floor] - 1).max() < 1e-6


def test_a_large_lamp_softens_the_shadow_only() -> None:
    hard, normals = rendered(scene(FLOOR, BALL), 192, 128)
    soft, _ = rendered(scene(FLOOR, BALL, radius_deg=15), 192, 128)
    floor = (normals[..., 1] > 0.999) & ~near_edge(normals)
    partial = [((light > 0.05) & (light < 0.95))[0, ..., 0][floor].sum() for light in (hard, soft)]
    assert partial[1] > 2.5 * partial[0]
    assert soft.min() >= 0
    assert soft[0].max() <= 1 + 1e-6
    assert np.allclose(soft[-1], hard[-1], atol=1e-2)


@pytest.mark.parametrize("rows", [2, 7, 64])
def test_blocks_of_any_height_give_the_same_picture(rows: int) -> None:
    renderer = Renderer(scene(FLOOR, BALL, direction=(0.5, 1, 0.3), radius_deg=5), 1, 96, 64)
    whole, whole_normals = renderer.block(slice(0, 64), GREY)
    parts = [renderer.block(slice(top, min(top + rows, 64)), GREY) for top in range(0, 64, rows)]
    assert np.allclose(np.concatenate([light for light, _ in parts], axis=1), whole, atol=1e-6)
    together = np.concatenate([normals for _, normals in parts])
    assert np.allclose(together, whole_normals, atol=1e-6, equal_nan=True)


def test_materials_colour_what_they_cover() -> None:
    card = {
        "kind": "box",
        "materials": ["a", "b"],
        "pattern": [2, 1],
        "centre": [0, 0, 0],
        "half": [0.8, 0.5, 0.1],
    }
    colours = np.array([[[1.0, 0.0]] * 2, [[0.0, 1.0]] * 2])
    light, _ = rendered(scene(card, direction=(0, 0, 1)), colours=colours)
    lamp = light[0, 32]
    assert np.allclose(lamp[40], [1, 0], atol=1e-6)
    assert np.allclose(lamp[56], [0, 1], atol=1e-6)
    assert np.allclose(lamp[44:52].sum(1), 1, atol=1e-6)  # blended where they meet
    assert np.allclose(lamp[:, 0], lamp[::-1, 1], atol=1e-6)  # in the very middle
    assert np.allclose(light[0], light[0, ::-1], atol=1e-6)
