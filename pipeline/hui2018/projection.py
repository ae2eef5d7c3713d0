"""Rotation to the north pole and projection on the tangent plane there (gnomonic).

Source: Hui et al. 2018, supplement, steps 2, 3 and the last one of Algorithms 1 and 2, figure 1.
Lines of the plane are great circles of the sphere: mixtures of two lights lie on a line.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.vectors import unit

_LEAST_HEIGHT = 0.1  # z; points nearer to the equator project towards infinity


def rotate_to_pole(center: Floats64) -> Floats64:
    """Rotation R (3, 3) that takes the direction of the center (3,) to the north pole (0, 0, 1).

    The azimuth is free in the source; here east stays in the plane at right angles to the y axis.
    """
    pole = unit(center)
    east = unit(np.cross([0.0, 1.0, 0.0] if abs(pole[1]) < 0.9 else [1.0, 0.0, 0.0], pole))
    return np.stack([east, np.cross(pole, east), pole])


def to_plane(gammas: Floats64, center: Floats64) -> tuple[Floats64, Floats64]:
    """Rotate the center to the north pole and project on the tangent plane (steps 2 and 3).

    Parameters
    ----------
    gammas : (n, 3) vectors
    center : (3,) direction that goes to the pole

    Returns
    -------
    points : (m, 2) projections of the vectors in front of the pole, more than 6° off the equator;
        the others have none
    rotation : (3, 3) with rotation @ center on the positive z axis
    """
    rotation = rotate_to_pole(center)
    rotated = unit(gammas) @ rotation.T
    front = rotated[rotated[:, 2] > _LEAST_HEIGHT]
    return front[:, :2] / front[:, 2:], rotation


def from_plane(points: Floats64, rotation: Floats64) -> Floats64:
    """Invert to_plane: (n, 2) points of the tangent plane → (n, 3) unit vectors (last step)."""
    return unit(np.column_stack([points, np.ones(len(points))]) @ rotation)
