from __future__ import annotations

import numpy as np
import pytest

from pipeline.calibration.sphere import sphere_outline, view_sphere
from pipeline.errors import OptionError
from pipeline.options import Circle

FOCAL, SIZE = 500.0, (400, 300)


def _outline(axis: float, half: float) -> Circle:
    """Ellipse of the cone of rays around a sphere to the right, by its own points."""
    d = np.array([np.sin(axis), 0, -np.cos(axis)])
    u, v = np.array([np.cos(axis), 0, np.sin(axis)]), np.array([0.0, 1.0, 0.0])
    t = np.linspace(0, 2 * np.pi, 20_001)[:, None]
    edge = np.cos(half) * d + np.sin(half) * (u * np.cos(t) + v * np.sin(t))
    x, y = FOCAL * edge[:, 0] / -edge[:, 2], FOCAL * edge[:, 1] / -edge[:, 2]
    radius = np.sqrt(np.ptp(x) * np.ptp(y)) / 2
    return Circle(x=(x.max() + x.min()) / 2 + SIZE[0] / 2, y=SIZE[1] / 2, radius=radius)


@pytest.mark.parametrize(
    ("axis", "half"),
    [
        (0.0, 0.1),
        (0.15, 0.15),
        (0.3, 0.05),
        (0.7, 0.3),
        (0.9, 0.05),
        (1.2, 0.1),
        (0.0, 1.2),
        (0.0, 1.3),
        (1.3, 0.02),
    ],
)
def test_points_lie_on_the_sphere(axis: float, half: float) -> None:
    circle = _outline(axis, half)
    angle = np.linspace(0, 6, 40)
    reach = circle.radius * np.linspace(0, 0.9, 40) * np.cos(axis)  # within the ellipse
    x, y = circle.x + reach * np.cos(angle), circle.y + reach * np.sin(angle)
    view = view_sphere(circle, x, y, FOCAL, SIZE)
    centre = np.array([np.sin(axis), 0, -np.cos(axis)])
    points = -view.towards * view.distance[:, None]
    assert np.linalg.norm(points - centre, axis=1) == pytest.approx(np.sin(half), rel=1e-4)
    assert view.normals == pytest.approx((points - centre) / np.sin(half), abs=1e-3)
    assert (np.einsum("ij,ij->i", view.normals, view.towards) > 0).all()
    # the pixel that a ray goes through
    assert -view.towards[:, 0] / view.towards[:, 2] * FOCAL + SIZE[0] / 2 == pytest.approx(x)


@pytest.mark.parametrize(("axis", "half"), [(0.0, 0.1), (0.3, 0.05), (0.7, 0.3), (0.0, 1.3)])
def test_the_outline_of_a_sphere_is_that_of_its_rays(axis: float, half: float) -> None:
    true = _outline(axis, half)
    seen_at = (SIZE[0] / 2 + FOCAL * np.tan(axis), SIZE[1] / 2)
    found = sphere_outline(seen_at, half, FOCAL, SIZE)
    assert (found.x, found.y) == pytest.approx((true.x, true.y), abs=1e-3)
    assert found.radius == pytest.approx(true.radius, rel=1e-5)


@pytest.mark.parametrize(("axis", "half"), [(0.9, 0.65), (0.9, 0.8), (0.0, 1.4)])
def test_a_sphere_too_near_has_no_outline(axis: float, half: float) -> None:
    with pytest.raises(OptionError, match="too near"):
        sphere_outline((SIZE[0] / 2 + FOCAL * np.tan(axis), SIZE[1] / 2), half, FOCAL, SIZE)


def test_axes_are_right_up_and_to_the_viewer() -> None:
    circle = Circle(x=200, y=150, radius=40)
    view = view_sphere(
        circle, np.array([200.0, 230.0, 200.0]), np.array([150.0, 150.0, 120.0]), FOCAL, SIZE
    )
    assert view.normals[0] == pytest.approx([0, 0, 1])
    assert view.normals[1, 0] > 0.7 and view.normals[1, 1] == pytest.approx(0)
    assert view.normals[2, 1] > 0.7 and view.normals[2, 0] == pytest.approx(0)
    assert view.distance[0] == pytest.approx(1 - np.sin(np.arctan(40 / FOCAL)))


@pytest.mark.parametrize("axis", [0.3, -0.3])
def test_a_sphere_above_is_one_beside_in_a_turned_picture(axis: float) -> None:
    beside = _outline(axis, 0.1)
    above = Circle(x=200, y=150 - (beside.x - 200), radius=beside.radius)
    reach = np.linspace(-0.9, 0.9, 7) * beside.radius
    across = view_sphere(beside, beside.x + reach, np.full(7, 150.0), FOCAL, SIZE)
    up = view_sphere(above, np.full(7, 200.0), above.y - reach, FOCAL, SIZE)
    assert up.normals[:, [1, 0, 2]] == pytest.approx(across.normals)
    assert up.normals[3, 1] * axis < 0
    assert up.distance == pytest.approx(across.distance)


def test_pixels_beside_the_sphere_are_its_edge() -> None:
    circle = Circle(x=200, y=150, radius=40)
    view = view_sphere(circle, np.array([260.0]), np.array([150.0]), FOCAL, SIZE)
    assert view.normals @ view.towards[0] == pytest.approx(0, abs=1e-9)
    assert view.normals[0, 0] > 0.99


@pytest.mark.parametrize(("axis", "half"), [(0.0, 1.36), (1.36, 0.02), (0.7, 0.85)])
def test_a_sphere_too_near_or_too_far_aside_is_refused(axis: float, half: float) -> None:
    with pytest.raises(OptionError, match="too near to the camera"):
        view_sphere(_outline(axis, half), np.array([200.0]), np.array([150.0]), FOCAL, SIZE)


@pytest.mark.parametrize("focal_px", [30.0, 1.0, 1e-300])
def test_a_focal_length_too_short_is_refused(focal_px: float) -> None:
    circle = Circle(x=380, y=290, radius=90)
    with pytest.raises(OptionError, match="too near to the camera"):
        view_sphere(circle, np.array([200.0]), np.array([150.0]), focal_px, SIZE)
