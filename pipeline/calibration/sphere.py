"""A sphere as a camera sees it: where its surface faces, from its outline alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.errors import OptionError
from pipeline.options import Circle
from pipeline.vectors import unit

_NARROWEST = 0.05  # cos(θ − α) cos(θ + α) of the cone, below which its edge is a grazing ray's

_TOO_NEAR = (
    "The sphere is too near to the camera, or the focal length too short: step back, or check the "
    "focal length."
)


@dataclass(frozen=True)
class SphereView:
    """What pixels inside a sphere's outline show.

    normals: (n, 3) unit, x right, y up, z to the viewer. towards: (n, 3) unit, to the camera.
    distance: (n,) to the camera, 1 that of the sphere's middle.
    """

    normals: Floats64
    towards: Floats64
    distance: Floats64


def view_sphere(
    circle: Circle, x: Floats64, y: Floats64, focal_px: float, size: tuple[int, int]
) -> SphereView:
    """Find where the surface of a sphere faces at pixels (n,) of its picture.

    circle: with the middle and the area of the ellipse that the outline is. x, y: of the pixels,
    from the upper left corner of the picture. focal_px: focal length in pixels. size: (width,
    height) of the picture, through whose middle the camera's axis goes. Pixels beside the sphere
    are taken for its edge. Raises OptionError for a sphere too near, or too far to the side.
    """
    middle = np.array([circle.x - size[0] / 2, size[1] / 2 - circle.y]) / focal_px
    axis_angle, half_angle = _cone(float(np.hypot(*middle)), circle.radius / focal_px)
    aside = middle / max(float(np.hypot(*middle)), 1e-12)
    centre = np.array([*(aside * np.sin(axis_angle)), -np.cos(axis_angle)])
    rays = view_rays(x, y, focal_px, size)
    along = rays @ centre
    radius = np.sin(half_angle)
    inside = np.maximum(radius**2 - (1 - along**2), 0.0)
    distance = along - np.sqrt(inside)
    return SphereView(unit(rays * distance[:, None] - centre), -rays, distance)


def view_rays(x: Floats64, y: Floats64, focal_px: float, size: tuple[int, int]) -> Floats64:
    """Directions (n, 3), unit, from the camera through pixels (n,); x right, y up, z to it."""
    across, up = (x - size[0] / 2) / focal_px, (size[1] / 2 - y) / focal_px
    return unit(np.stack([across, up, -np.ones_like(across)], axis=1))


def sphere_outline(
    middle: tuple[float, float], half_angle: float, focal_px: float, size: tuple[int, int]
) -> Circle:
    """Middle and area of the ellipse that a sphere's outline is, for view_sphere.

    middle: pixel (x, y) at which the sphere's own middle is seen, which is not the ellipse's.
    half_angle: of the cone of rays around the sphere, radians. Raises OptionError for a sphere too
    near, or too far to the side.
    """
    aside = np.array(middle) - np.array(size) / 2
    offset = float(np.hypot(*aside)) / focal_px
    axis_angle = np.arctan(offset)
    narrow = np.cos(axis_angle - half_angle) * np.cos(axis_angle + half_angle)
    if axis_angle + half_angle >= np.pi / 2 or narrow <= _NARROWEST:
        raise OptionError(_TOO_NEAR)
    near, far = np.tan(axis_angle - half_angle), np.tan(axis_angle + half_angle)
    radius = np.sqrt((far - near) / 2 * np.sin(half_angle) / np.sqrt(narrow)) * focal_px
    moved = aside * (((near + far) / 2 / offset) if offset > 0 else 1.0) + np.array(size) / 2
    return Circle(x=float(moved[0]), y=float(moved[1]), radius=float(radius))


def _cone(offset: float, radius: float) -> tuple[float, float]:
    """Angles of the cone of rays around a sphere: its axis to the camera's, and half its opening.

    offset, radius: of the outline's ellipse, by the focal length. A cone of half angle α about an
    axis θ aside is seen as an ellipse that reaches from tan(θ − α) to tan(θ + α), with the other
    semi-axis sin α/√(cos(θ − α) cos(θ + α)). By both, the ratio w of the semi-axes is the one
    positive root of w³ + radius² w² − (1 + offset²) w − radius².
    """
    if offset + radius < 1 / _NARROWEST:  # beyond, cos(θ + α) alone is below
        ratio = float(np.roots([1.0, radius**2, -1.0 - offset**2, -(radius**2)]).real.max())
        reach = radius * np.sqrt(ratio)
        near, far = float(np.arctan(offset - reach)), float(np.arctan(offset + reach))
        if np.cos(near) * np.cos(far) > _NARROWEST:
            return (near + far) / 2, (far - near) / 2
    raise OptionError(_TOO_NEAR)
