from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.sim.scene import Shape
from drivers.sim.shapes import Solid, Sweep, build


def shape(kind: str, **options: object) -> Shape:
    fields = {"kind": kind, "materials": ("m",), "centre": (0, 0, 0), "half": (1, 1, 1), **options}
    return Shape.model_validate(fields)


def solid(kind: str, **options: object) -> Solid:
    (built,) = build((shape(kind, **options),))
    assert isinstance(built, Solid)
    return built


def met(body: Solid | Sweep, origin: list[float], direction: list[float]) -> float:
    return float(body.enter(np.array(origin), np.array([direction], float))[0])


@pytest.mark.parametrize(
    ("kind", "half", "origin", "direction", "distance"),
    [
        ("sphere", (2, 2, 2), [0, 0, 5], [0, 0, -1], 3),
        ("sphere", (1, 3, 1), [0, 9, 0], [0, -1, 0], 6),
        ("sphere", (1, 1, 1), [0, 0.6, 5], [0, 0, -1], 4.2),
        ("sphere", (1, 1, 1), [0, 1.01, 5], [0, 0, -1], np.inf),
        ("sphere", (1, 1, 1), [0, 0, 5], [0, 0, 1], np.inf),
        ("box", (1, 2, 3), [0.9, 1.9, 5], [0, 0, -1], 2),
        ("box", (1, 2, 3), [1.1, 1.9, 5], [0, 0, -1], np.inf),
        ("box", (1, 2, 3), [5, 0, 0], [-2, 0, 0], 2),
        ("cylinder", (1, 2, 1), [0, 1.9, 5], [0, 0, -1], 4),
        ("cylinder", (1, 2, 1), [0, 2.1, 5], [0, 0, -1], np.inf),
        ("cylinder", (1, 2, 1), [0.5, 5, 0.5], [0, -1, 0], 3),
        ("cylinder", (1, 2, 1), [0.9, 5, 0.9], [0, -1, 0], np.inf),
    ],
)
def test_rays_enter_where_geometry_says(
    kind: str,
    half: tuple[float, float, float],
    origin: list[float],
    direction: list[float],
    distance: float,
) -> None:
    assert met(solid(kind, half=half), origin, direction) == pytest.approx(distance)


def test_shapes_are_moved_and_turned() -> None:
    turned = solid("box", half=(1, 1, 2), turn=90, centre=(10, 0, 0))
    assert met(turned, [0, 0, 0], [1, 0, 0]) == pytest.approx(8)
    assert met(turned, [10, 0, 9], [0, 0, -1]) == pytest.approx(8)
    tilted = solid("cylinder", half=(1, 3, 1), tilt=90)
    assert met(tilted, [0, 0, 9], [0, 0, -1]) == pytest.approx(6)
    rolled = solid("cylinder", half=(1, 3, 1), roll=90)
    assert met(rolled, [9, 0, 0], [-1, 0, 0]) == pytest.approx(6)


@pytest.mark.parametrize("kind", ["sphere", "box", "cylinder"])
def test_normals_are_those_of_the_surface(kind: str) -> None:
    """Compare with the gradient of the entry distance seen along the normal itself."""
    rng = np.random.default_rng(3)
    body = solid(kind, half=(0.5, 0.9, 0.7), turn=20, tilt=-30, roll=15, centre=(0.1, 0.2, 0.3))
    from_all_sides = rng.standard_normal((200, 3))
    from_all_sides /= np.linalg.norm(from_all_sides, axis=1, keepdims=True)
    origins = body.centre + 4 * from_all_sides
    points = origins - from_all_sides * body.enter(origins, -from_all_sides)[:, None]
    normals = body.normals(points)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    assert (np.einsum("ni,ni->n", normals, from_all_sides) > 0).all()
    for offset in np.eye(3):
        beside = offset - normals * (normals @ offset)[:, None]  # along the surface
        starts = points + normals * 0.5 + 1e-4 * beside
        height = 0.5 - body.enter(starts, -normals)
        smooth = np.isfinite(height)
        assert smooth.mean() > 0.95
        assert np.median(np.abs(height[smooth])) < 1e-7  # second order: the surface is tangent


def test_the_bounding_sphere_holds_the_shape() -> None:
    for kind in ("sphere", "box", "cylinder"):
        body = solid(kind, half=(0.5, 0.9, 0.7), turn=20, roll=50)
        rng = np.random.default_rng(5)
        towards = rng.standard_normal((2000, 3))
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        depth = body.enter(towards * 4, -towards)
        assert (4 - depth).max() <= body.radius + 1e-9


def test_patterns_count_cells_from_the_lower_left() -> None:
    chart = solid("box", pattern=(3, 2), half=(3, 2, 1))
    points = np.array([[-2.0, -1, 1], [0, -1, 1], [2, -1, 1], [-2, 1, 1], [2.99, 1.99, 1]])
    assert chart.cells(points).tolist() == [0, 1, 2, 3, 5]
    bands = solid("sphere", pattern=(1, 4))
    points = np.array([[0, y, np.sqrt(1 - y * y)] for y in (-0.9, -0.3, 0.3, 0.9)])
    assert bands.cells(points).tolist() == [0, 1, 2, 3]
    around = solid("cylinder", pattern=(4, 1))
    points = np.array([[-0.6, 0, -0.8], [-0.6, 0, 0.8], [0.6, 0, 0.8], [0.6, 0, -0.8]])
    assert around.cells(points).tolist() == [0, 1, 2, 3]


def test_a_gap_is_of_the_material_after_the_cells() -> None:
    chart = solid("box", pattern=(2, 1), half=(2, 1, 1), gap=0.2)  # cells of 2 × 2, 0.2 left free
    points = np.array([[-1, 0, 1], [-0.21, 0, 1], [-0.19, 0, 1], [0.19, 0, 1], [0.21, 0, 1]])
    assert chart.cells(points).tolist() == [0, 0, 2, 2, 1]
    points = np.array([[1, 0.79, 1], [1, 0.81, 1], [1.81, 0, 1], [-1, -0.81, 1]])
    assert chart.cells(points).tolist() == [1, 2, 2, 2]


@pytest.mark.parametrize("fields", [{"gap": 1.0}, {"gap": -0.1}, {"mirror": 1.1}, {"mirror": -1}])
def test_impossible_gaps_and_mirrors_are_refused(fields: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        shape("box", **fields)


def test_a_sweep_is_floor_curve_and_wall() -> None:
    (sweep,) = build((shape("sweep", half=(1, 0.5, 2)),))
    assert met(sweep, [0, 3, 0], [0, -1, 0]) == pytest.approx(3)
    assert met(sweep, [0, 3, 3], [0, 0, -1]) == pytest.approx(5)
    into_the_curve = met(sweep, [0, 0.5, -1.5], [0, -(0.5**0.5), -(0.5**0.5)])
    assert into_the_curve == pytest.approx(0.5)
    points = np.array([[0, 0, 0], [0, 3, -2], [0, 0.5 - 0.5**1.5, -1.5 - 0.5**1.5]])
    slope = 0.5**0.5
    assert np.allclose(sweep.normals(points), [[0, 1, 0], [0, 0, 1], [0, slope, slope]])
    assert sweep.cells(points).tolist() == [0, 0, 0]
