from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.calibration import sphere_fit as module
from pipeline.calibration.lamps_and_flash import LampsAndFlash
from pipeline.calibration.sphere_fit import SphereFit, SphereLight, fit_lamps
from pipeline.options import Circle
from pipeline.vectors import unit

SIZE, CIRCLE, MIDDLE = (200, 160), Circle(x=104, y=77, radius=50), Circle(x=100, y=80, radius=50)
FAR, NEAR = 1e6, 200.0
LAMPS = unit(np.array([(-0.9, 0.3, 0.2), (0.6, -0.5, 0.5), (0.1, 0.8, 0.4)]))
COLOURS = np.array([(0.3, 0.2, 0.1), (0.2, 0.25, 0.15), (0.1, 0.1, 0.3)])


def seen(
    lamps: Floats64,
    colours: Floats64,
    focal_px: float = FAR,
    flash_at: tuple[float, float] = (0.0, 0.0),
    albedo: Any = 1.0,
    noise: float = 0.0,
    flash_noise: float = 0.0,
    seed: int = 1,
    marked: Circle | None = None,
) -> SphereLight:
    """Light of a sphere, CIRCLE from afar or MIDDLE from near, shown by every fourth pixel.

    flash_at: in the plane of the lens, by the sphere's distance. noise: relative, of the lamps'
    light; with any, paint is uneven by a hundredth.
    """
    circle = CIRCLE if focal_px == FAR else MIDDLE
    y, x = (at.ravel() + 0.5 for at in np.mgrid[: SIZE[1] : 4, : SIZE[0] : 4])
    near = np.hypot(x - circle.x, y - circle.y) < 0.9 * circle.radius
    x, y = x[near], y[near]
    if focal_px == FAR:
        across = np.stack([x - circle.x, circle.y - y], axis=1) / circle.radius
        normals = np.column_stack([across, np.sqrt(1 - (across**2).sum(axis=1))])
        by_flash = normals[:, 2]
    else:
        radius = np.sin(np.arctan(circle.radius / focal_px))
        rays = unit(np.stack([x - 100, 80 - y, np.full_like(x, -focal_px)], axis=1))
        along = -rays[:, 2]
        places = rays * (along - np.sqrt(radius**2 - 1 + along**2))[:, None]
        normals = (places + np.array([0.0, 0.0, 1.0])) / radius
        way = np.array([*flash_at, 0.0]) - places
        by_flash = np.maximum((normals * way).sum(1), 0) / np.linalg.norm(way, axis=1) ** 3
    random = np.random.default_rng(seed)
    paint = 1 + (0.01 * random.standard_normal(len(x)) if noise else 0.0)
    albedo = np.broadcast_to(albedo * paint, len(x))[:, None]
    lit = albedo * (np.maximum(normals @ lamps.T, 0.0) @ colours)
    lit = lit * (1 + noise * random.standard_normal(lit.shape))
    flash = albedo * by_flash[:, None] * [0.8, 1.0, 0.6]
    by_flash = flash * (1 + flash_noise * random.standard_normal(flash.shape))
    variances = 1e-8 + (noise * lit) ** 2, 1e-8 + (flash_noise * flash) ** 2
    return SphereLight(
        x, y, marked or circle, focal_px, SIZE, LampsAndFlash(lit, by_flash, *variances)
    )


def errors(found: SphereFit, lamps: Floats64) -> tuple[Floats64, list[int]]:
    """Angles in degrees in the best order, and that order."""
    degrees = np.degrees(np.arccos(np.clip(lamps @ found.directions.T, -1, 1)))
    rows = np.arange(len(lamps))
    order = min(permutations(rows), key=lambda order: degrees[rows, list(order)].sum())
    return degrees[rows, list(order)], [int(i) for i in order]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_lamps_that_are_known_are_found(count: int) -> None:
    found = fit_lamps(seen(LAMPS[:count], COLOURS[:count]), count)
    off, order = errors(found, LAMPS[:count])
    assert off == pytest.approx(0, abs=0.05)
    assert np.linalg.norm(found.directions, axis=1) == pytest.approx(1)
    assert found.colours[order] == pytest.approx(COLOURS[:count], rel=1e-3)
    assert found.moved == pytest.approx(0, abs=1e-3)
    assert found.flash_aside_deg < 0.05
    assert (found.misfit, found.flash_misfit) == pytest.approx((0, 0), abs=1e-3)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_three_lamps_near_each_other_are_not_taken_for_lamps_that_take_light_away(
    seed: int,
) -> None:
    """Two are 37° apart: starts with one bright lamp and one of negative light explain as much."""
    lamps = unit(np.array([(0.357, 0.351, 0.866), (0.217, -0.835, 0.506), (-0.283, 0.335, 0.899)]))
    colours = np.array([(0.199, 0.113, 0.187), (0.115, 0.330, 0.057), (0.123, 0.118, 0.393)])
    found = fit_lamps(seen(lamps, colours, noise=0.005, seed=seed), 3)
    assert errors(found, lamps)[0].max() < 1
    assert found.colours.min() > 0.05


def test_a_sphere_without_light_is_no_fit_and_no_fault() -> None:
    """Every warning of NumPy's would be an error here."""
    lit = seen(LAMPS[:1], COLOURS[:1])
    dark = np.zeros_like(lit.lights.lamps)
    found = fit_lamps(replace(lit, lights=replace(lit.lights, lamps=dark, flash=dark)), 1)
    assert not found.flash_misfit < 0.5


def test_a_lamp_behind_the_sphere_is_found() -> None:
    behind = unit(np.array([(0.9, 0.2, -0.35)]))
    assert errors(fit_lamps(seen(behind, COLOURS[:1]), 1), behind)[0] < 0.1


def test_paint_changes_nothing() -> None:
    """Stripes of two greys are in the light of lamps and flash alike."""
    even = seen(LAMPS[:2], COLOURS[:2])
    stripes = np.where(even.x // 8 % 2, 1.0, 0.9)
    found = fit_lamps(seen(LAMPS[:2], COLOURS[:2], albedo=stripes), 2)
    assert errors(found, LAMPS[:2])[0].max() < 0.3
    assert found.misfit < 0.01


@pytest.mark.parametrize("flash_at", [(0.0, 0.0), (0.1, 0.0), (0.0, -0.1)])
def test_the_flash_is_placed_by_its_own_light(flash_at: tuple[float, float]) -> None:
    found = fit_lamps(seen(LAMPS[:1], COLOURS[:1], NEAR, flash_at), 1)
    degrees = float(np.degrees(np.arctan(np.hypot(*flash_at))))
    assert found.flash_aside_deg == pytest.approx(degrees, abs=0.1)
    assert errors(found, LAMPS[:1])[0] == pytest.approx(0, abs=0.1)
    assert found.flash_misfit < 0.002


@pytest.mark.parametrize(("dx", "dy", "wider"), [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0, 0, -1.0)])
def test_an_outline_marked_aside_is_moved_back(dx: float, dy: float, wider: float) -> None:
    marked = Circle(x=MIDDLE.x + dx, y=MIDDLE.y + dy, radius=MIDDLE.radius + wider)
    found = fit_lamps(seen(LAMPS[:2], COLOURS[:2], NEAR, marked=marked), 2)
    assert found.moved * marked.radius == pytest.approx(np.array([-dx, -dy, -wider]), abs=0.03)
    assert errors(found, LAMPS[:2])[0] == pytest.approx(0, abs=0.1)


def test_faint_light_moves_neither_the_mark_nor_the_flash_all_the_way() -> None:
    """From where they are likeliest: within 0.02 of the radius, and 0.05 of the distance."""
    marked = Circle(x=MIDDLE.x + 1, y=MIDDLE.y, radius=MIDDLE.radius)
    outline = seen(LAMPS[:1], COLOURS[:1], NEAR, marked=marked)
    beside = seen(LAMPS[:1], COLOURS[:1], NEAR, (0.1, 0.0))
    for light, deviation in ((outline, 0.2), (beside, 1.0)):
        light.lights.lamps_variance[...] = light.lights.flash_variance[...] = deviation**2
    moved = fit_lamps(outline, 1).moved * marked.radius
    assert moved == pytest.approx([-0.57, -0.01, 0.015], abs=0.02)
    # of 5.7°
    assert fit_lamps(beside, 1).flash_aside_deg == pytest.approx(4.06, abs=0.05)


def test_what_lamps_do_not_explain_is_told() -> None:
    """One lamp for two leaves light over, and costs more than two."""
    light = seen(LAMPS[:2], COLOURS[:2])
    one, two = (fit_lamps(light, count) for count in (1, 2))
    assert one.misfit > 0.1
    assert one.cost > 1.0 > 1e3 * two.cost


def test_what_is_told_of_errors_is_what_repeated_photographs_show() -> None:
    lamp, colour = LAMPS[1:2], COLOURS[1:2]
    clean = seen(lamp, colour, NEAR).lights.lamps
    fits = [fit_lamps(seen(lamp, colour, NEAR, noise=0.05, seed=k), 1) for k in range(8)]
    off = np.array([errors(fit, lamp)[0][0] for fit in fits])
    assert 0.4 < np.mean(np.square(off / [fit.deviations_deg[0] for fit in fits])) < 1.0
    noise = 0.05 * np.sqrt(np.mean(clean**2)) / clean.mean()
    assert np.mean([fit.misfit for fit in fits]) == pytest.approx(noise, rel=0.05)
    # √(1 + z²) − 1 of normal z is 0.35 in the mean, and the flash adds a third at most
    assert np.mean([fit.cost for fit in fits]) == pytest.approx(0.41, abs=0.06)


@pytest.mark.parametrize("off_deg", [0.0, 60.0, 85.0])
def test_how_sure_a_lamp_is_does_not_hang_on_where_it_was_looked_for_first(
    monkeypatch: pytest.MonkeyPatch, off_deg: float
) -> None:
    """Of lamps found from 85° off every one was refused as not told from the others."""
    off = np.radians(off_deg)
    aside = unit(np.cross(LAMPS[1], [0.0, 1.0, 0.0]))
    start = np.cos(off) * LAMPS[1] + np.sin(off) * aside
    monkeypatch.setattr(module, "_starts", lambda *_: [start[None]])
    found = fit_lamps(seen(LAMPS[1:2], COLOURS[1:2], NEAR, noise=0.05), 1)
    assert errors(found, LAMPS[1:2])[0] < 0.5
    assert found.deviations_deg == pytest.approx(0.16, rel=0.2)


def test_noise_of_the_flash_is_in_what_is_told_of_it_and_of_the_lamps() -> None:
    """Of 0.05 in each channel, of which the sum of three has 0.05·√(0.8² + 1² + 0.6²)/2.4."""
    lamp, colour = LAMPS[1:2], COLOURS[1:2]
    clean = seen(lamp, colour, NEAR).lights.flash.sum(axis=1)
    fits = [fit_lamps(seen(lamp, colour, NEAR, flash_noise=0.05, seed=k), 1) for k in range(4)]
    noise = 0.05 * np.sqrt(2.0) / 2.4 * np.sqrt(np.mean(clean**2)) / clean.mean()
    assert np.mean([fit.flash_misfit for fit in fits]) == pytest.approx(noise, rel=0.1)
    # lamps are divided by the flash, and err alike in three channels
    assert np.mean([fit.cost for fit in fits]) == pytest.approx(0.41, abs=0.1)


def test_pixels_that_are_uncertain_hardly_count() -> None:
    light = seen(LAMPS[:2], COLOURS[:2])
    light.lights.lamps[::9] += 1.0
    light.lights.lamps_variance[::9] = 1e6
    found = fit_lamps(light, 2)
    off, order = errors(found, LAMPS[:2])
    assert off == pytest.approx(0, abs=0.05)
    assert found.colours[order] == pytest.approx(COLOURS[:2], rel=1e-3)


def test_the_rim_does_not_count() -> None:
    """Where a surface hardly faces the camera the flash is faint, and a mark may miss it."""
    light = seen(LAMPS[:1], COLOURS[:1])
    angle = np.arange(0.0, 2 * np.pi, 0.1)
    x, y = CIRCLE.x + 49 * np.cos(angle), CIRCLE.y + 49 * np.sin(angle)
    nonsense = np.tile([0.5, 0.1, 0.9], (len(angle), 1))
    values = light.lights
    parts = values.lamps, values.flash, values.lamps_variance, values.flash_variance
    with_rim = LampsAndFlash(*(np.vstack([part, nonsense]) for part in parts))
    rimmed = replace(light, x=np.append(light.x, x), y=np.append(light.y, y), lights=with_rim)

    np.testing.assert_array_equal(fit_lamps(rimmed, 1).directions, fit_lamps(light, 1).directions)


def test_a_faint_lamp_is_less_certain() -> None:
    colours = COLOURS[:2] * [[1.0], [0.1]]
    found = fit_lamps(seen(LAMPS[:2], colours, noise=0.02), 2)
    strong, faint = found.deviations_deg[errors(found, LAMPS[:2])[1]]
    assert faint > 4 * strong


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_start_that_ends_best_is_taken(
    monkeypatch: pytest.MonkeyPatch, order: tuple[int, int]
) -> None:
    """From behind the sphere, a lamp that lights nothing leads nowhere."""
    starts = [np.array([(0.1, 0.0, -1.0)]), np.array([(0.5, -0.5, 0.5)])]
    monkeypatch.setattr(module, "_starts", lambda *_: [starts[k] for k in order])
    found = fit_lamps(seen(LAMPS[1:2], COLOURS[1:2], NEAR), 1)
    assert errors(found, LAMPS[1:2])[0] == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("moved", [(0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1)])
def test_a_view_of_an_outline_moved_by_radii(moved: tuple[float, float, float]) -> None:
    light = seen(LAMPS[:1], COLOURS[:1])
    dx, dy, wider = moved
    view = light.view(np.array(moved))
    # ten pixels from the middle, on a sphere of 50 or 55
    x = (light.x - CIRCLE.x - 50 * dx) / (50 * (1 + wider))
    y = (CIRCLE.y + 50 * dy - light.y) / (50 * (1 + wider))
    inside = np.hypot(x, y) < 0.9
    assert view.normals[inside, 0] == pytest.approx(x[inside], abs=1e-3)
    assert view.normals[inside, 1] == pytest.approx(y[inside], abs=1e-3)


def test_errors_of_the_flash_scale_with_its_light() -> None:
    bright = seen(LAMPS, COLOURS, flash_noise=0.02)
    lights = bright.lights
    dark = replace(
        bright,
        lights=LampsAndFlash(
            0.01 * lights.lamps,
            0.01 * lights.flash,
            1e-4 * lights.lamps_variance,
            1e-4 * lights.flash_variance,
        ),
    )
    deviations = [
        module._Problem(one, one.view(np.zeros(3)))._flash_deviation for one in (bright, dark)
    ]
    np.testing.assert_allclose(deviations[1], 0.01 * deviations[0])
