"""Renderings against geometry and integrals worked out here by other means."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from tests.evaluation.geometry import Geometry, Lamp, Shape, View
from tests.evaluation.layouts import make_geometry
from tests.evaluation.patterns import Pattern
from tests.evaluation.render import render
from tests.evaluation.transport import DirectTransport

SIZE = (48, 36)
FACTOR = 3
PLAIN = Pattern("plain", (0,))
FLOOR = Shape("plane", (0, 0, 0), (90, 90, 90), PLAIN, tilt_deg=-90, plastic=False)
BALL = Shape("sphere", (0.2, 0.4, 0), (0.4, 0.4, 0.4), PLAIN)
LAMPS = (Lamp((1.5, 2.0, 1.0)), Lamp((-2.0, 1.5, 0.5)))
SCENE = Geometry((FLOOR, BALL), LAMPS, View(position=(0, 1.5, 3), look_at=(0, 0.3, 0)))
WHITE = np.ones((1, len(WAVELENGTHS_NM)))
LIGHT = np.full((len(WAVELENGTHS_NM), 1), 1 / len(WAVELENGTHS_NM))  # of unit power


def rays(view: View, size: tuple[int, int] = SIZE) -> tuple[Floats64, Floats64]:
    """Position of the camera and directions (h, w, 3) through the centres of sub-pixels."""
    at = np.array(view.position)
    forward = np.array(view.look_at) - at
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0, 1, 0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    width, height = size[0] * FACTOR, size[1] * FACTOR
    focal = width / 2 / np.tan(np.radians(view.fov_deg / 2))
    x = (np.arange(width) + 0.5 - width / 2) / focal
    y = (height / 2 - np.arange(height) - 0.5) / focal
    out = forward + x[None, :, None] * right + y[:, None, None] * up
    return at, out / np.linalg.norm(out, axis=2, keepdims=True)


def to_ball(start: Floats64, way: Floats64) -> Floats64:
    """Distance to the ball along unit ways, infinite where they miss it."""
    to = np.array(BALL.centre) - start
    along = np.sum(to * way, axis=-1)
    inside = BALL.size[0] ** 2 - (np.sum(to * to, axis=-1) - along**2)
    reach = along - np.sqrt(np.maximum(inside, 0))
    return np.where((inside > 0) & (reach > 1e-6), reach, np.inf)


def irradiance(lamp: Lamp) -> Floats64:
    """Cosine over the square of the distance where the lamp is seen, (h, w), by sub-pixel."""
    at, way = rays(SCENE.view)
    down = way[..., 1] < 0
    floor = np.where(down, -at[1] / np.where(down, way[..., 1], -1), np.inf)
    ball = to_ball(at, way)
    distance = np.minimum(floor, ball)
    point = at + way * np.where(np.isfinite(distance), distance, 0)[..., None]
    normal = np.where(
        (ball < floor)[..., None], (point - np.array(BALL.centre)) / BALL.size[0], (0.0, 1.0, 0.0)
    )
    to_lamp = np.array(lamp.centre) - point
    away = np.linalg.norm(to_lamp, axis=2)
    to_lamp /= away[..., None]
    seen = np.isinf(to_ball(point + 1e-4 * normal, to_lamp)) & np.isfinite(distance)
    return np.where(seen, np.maximum(np.sum(normal * to_lamp, axis=2), 0) / away**2, 0)


def to_pixels(values: Floats64) -> Floats64:
    blocks = values.reshape(SIZE[1], FACTOR, SIZE[0], FACTOR)
    return np.asarray(blocks.mean(axis=(1, 3)))


@pytest.mark.parametrize("lamp", [0, 1])
def test_a_ball_on_a_floor_is_lit_by_inverse_square_and_cosine(lamp: int) -> None:
    transport = render(SCENE, WHITE, SIZE)

    seen = transport.picture(lamp, LIGHT, WHITE)[..., 0]

    expected = to_pixels(irradiance(LAMPS[lamp]))
    off = np.abs(seen - expected) > 1e-4 * expected.max()
    assert off.mean() < 0.005  # a ray that grazes the rim may fall on either side
    assert expected[~off].max() > 0.1


def test_a_shadow_is_black_for_its_lamp_alone() -> None:
    transport = render(SCENE, WHITE, SIZE)
    shadow = to_pixels((irradiance(LAMPS[0]) == 0) & (irradiance(LAMPS[1]) > 0.01)) == 1
    assert shadow.sum() > 20

    first, second = (transport.picture(lamp, LIGHT, WHITE)[..., 0] for lamp in range(2))

    assert np.median(first[shadow]) == 0
    assert first[shadow].mean() < 1e-3 * second[shadow].mean()
    assert second[shadow].min() > 0.009


def test_each_texel_reflects_as_its_mixture() -> None:
    thirds = np.stack([np.linspace(0.1, 0.7, len(WAVELENGTHS_NM)), WHITE[0] * 0.5])
    stone = replace(BALL, pattern=Pattern("texture", (0, 1), seed=3))
    light = np.eye(len(WAVELENGTHS_NM))[:, [10, 60]]
    transport = render(replace(SCENE, shapes=(stone,)), thirds, SIZE)
    assert isinstance(transport, DirectTransport)

    seen = transport.picture(0, light, thirds)
    lit = transport.picture(0, light, np.ones_like(thirds))

    share = (seen[lit > 0.01] / lit[lit > 0.01]).reshape(-1, 2)
    mixed = (share - thirds[0, [10, 60]]) / (thirds[1, [10, 60]] - thirds[0, [10, 60]])
    np.testing.assert_allclose(mixed[:, 0], mixed[:, 1], atol=1e-4)
    assert mixed.min() > -1e-5
    assert mixed.max() < 1 + 1e-5
    assert mixed.std() > 0.2


def test_gloss_is_white_and_only_on_plastic() -> None:
    transport = render(replace(SCENE, roughness=0.1), WHITE, SIZE)
    light = np.eye(len(WAVELENGTHS_NM))[:, [10, 60]]

    gloss = transport.picture(0, light, 0 * WHITE)
    floor = to_pixels(np.isinf(to_ball(*rays(SCENE.view)))) == 1

    np.testing.assert_array_equal(gloss[..., 0], gloss[..., 1])
    at, way = rays(SCENE.view)
    point = at + way * np.where(np.isinf(to_ball(at, way)), 0, to_ball(at, way))[..., None]
    half = np.array(LAMPS[0].centre) - point
    half = half / np.linalg.norm(half, axis=2, keepdims=True) - way
    half /= np.linalg.norm(half, axis=2, keepdims=True)
    mirrors = to_pixels(np.sum(half * (point - BALL.centre), axis=2) / BALL.size[0])
    brightest = np.unravel_index(gloss[..., 0].argmax(), mirrors.shape)
    assert mirrors[brightest] > np.cos(np.radians(5))
    assert gloss[floor].max() == 0


def test_light_of_one_bounce_is_the_integral_over_the_wall() -> None:
    # bright below, black above: also settles which way up the renderer hangs patterns
    size = (96, 72)
    stripes = Pattern("stripes", (1, 2), 2)
    wall = Shape("plane", (0, 1, 0), (1, 1, 1), stripes)
    floor = replace(FLOOR, pattern=PLAIN)
    lamp = Lamp((0.3, 1.2, 1.5))
    view = View(position=(0, 1.0, 3.0), look_at=(0, 0.3, 0.5))
    palette = np.array([[0.6], [0.8], [0.0]]) * WHITE
    geometry = Geometry((floor, wall), (lamp,), view, depth=3)

    bounced = render(geometry, palette, size).picture(0, LIGHT, palette)[..., 0]
    direct = render(replace(geometry, depth=2), palette, size).picture(0, LIGHT, palette)[..., 0]

    at, way = rays(view, size)
    side = (np.arange(200) + 0.5) / 100 - 1
    x, y = np.meshgrid(side, side[:100] + 1)  # the lower half
    on_wall = np.stack([x, y, np.zeros_like(x)], axis=2)
    to_lamp = np.array(lamp.centre) - on_wall
    lit = to_lamp[..., 2] / np.linalg.norm(to_lamp, axis=2) ** 3
    for row, column in [(46, 20), (50, 50), (60, 80)]:
        centre = way[row * FACTOR + 1, column * FACTOR + 1]
        to_point = at - centre * at[1] / centre[1] - on_wall
        form = to_point[..., 2] * y / np.linalg.norm(to_point, axis=2) ** 4 / np.pi
        expected = 0.6 * 0.8 * np.sum(lit * form) * 0.01**2
        seen = (bounced - direct)[row - 1 : row + 2, column - 1 : column + 2].mean()
        assert seen == pytest.approx(expected, rel=0.05)  # smoothing flattens


def test_a_ball_alone_bounces_nothing_back() -> None:
    palette = np.array([np.interp(WAVELENGTHS_NM, [390, 730], [0.2, 0.8])])
    alone = replace(SCENE, shapes=(BALL,))

    bounced = render(replace(alone, depth=None), palette, SIZE).picture(0, LIGHT, palette)
    direct = render(alone, palette, SIZE).picture(0, LIGHT, palette)

    np.testing.assert_allclose(bounced, direct, atol=1e-5)


def test_bounces_among_plastic_are_refused() -> None:
    with pytest.raises(ValueError, match="matte"):
        render(replace(SCENE, depth=3, roughness=0.2), WHITE, SIZE)


def test_nothing_shadows_anything_in_a_smooth_scene() -> None:
    geometry = next(g for g in (make_geometry("smooth", s, 2) for s in range(9)) if g.shapes[1:])
    together = render(geometry, np.repeat(WHITE, 40, axis=0), SIZE)
    alone = [
        render(replace(geometry, shapes=(shape,)), np.repeat(WHITE, 40, axis=0), SIZE)
        for shape in geometry.shapes
    ]
    for lamp in range(2):
        pictures = [part.picture(lamp, LIGHT, WHITE.repeat(40, axis=0)) for part in alone]
        np.testing.assert_allclose(
            together.picture(lamp, LIGHT, WHITE.repeat(40, axis=0)), sum(pictures), atol=1e-6
        )
