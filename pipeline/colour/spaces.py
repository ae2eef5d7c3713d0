"""Colour spaces of pictures, by their primaries."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Matrix

Primaries = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]

SRGB_PRIMARIES: Primaries = ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060))
"""CIE xy of red, green and blue, IEC 61966-2-1 (as Rec. ITU-R BT.709)."""
REC2020_PRIMARIES: Primaries = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046))
"""CIE xy of red, green and blue, Rec. ITU-R BT.2020."""
ADOBE_RGB_PRIMARIES: Primaries = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06))
"""CIE xy of red, green and blue, Adobe RGB (1998), 4.3.1.1."""
D65_XY = (0.3127, 0.3290)
"""CIE xy of the white of all of them."""


def xy_to_xyz(xy: tuple[float, float]) -> Floats64:
    """CIE xy → XYZ with Y = 1."""
    x, y = xy
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def rgb_to_xyz(primaries: Primaries, white: tuple[float, float] = D65_XY) -> Matrix:
    """Matrix (3, 3) from linear RGB to CIE XYZ, (1, 1, 1) → white of Y = 1 (SMPTE RP 177).

    white: CIE xy.
    """
    columns = np.array([xy_to_xyz(xy) for xy in primaries]).T
    matrix: Matrix = columns * np.linalg.solve(columns, xy_to_xyz(white))
    return matrix


_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
_LEAST_CONE = 0.02  # of the largest, so that the whitest of a coloured lamp has gains that end


def adaptation(white: Floats64, other: Floats64) -> Matrix:
    """Bradford adaptation (3, 3) of CIE XYZ from one white to another, XYZ (3,) both.

    Whites no eye can see, which have cones below 0, are taken for the nearest that have none.
    """
    cones, wanted = (_BRADFORD @ one for one in (white, other))
    gain = np.maximum(wanted, 0.0) / np.maximum(cones, _LEAST_CONE * cones.max())
    return np.asarray(np.linalg.solve(_BRADFORD, gain[:, None] * _BRADFORD))


def adapts(white: Floats64) -> bool:
    """Whether adaptation takes a white, CIE XYZ (3,), just to the other, its luminance kept.

    Not where it lacks a cone's light or a camera's matrix makes it one no eye can see: a lamp of
    nearly one wavelength has a cone at or below 0.02 of the largest.
    """
    cones = _BRADFORD @ white
    return bool(cones.min() > _LEAST_CONE * cones.max())


XYZ_TO_SRGB: Matrix = np.asarray(np.linalg.inv(rgb_to_xyz(SRGB_PRIMARIES)), dtype=np.float64)
"""CIE XYZ (D65) → linear sRGB."""
XYZ_TO_REC2020: Matrix = np.asarray(np.linalg.inv(rgb_to_xyz(REC2020_PRIMARIES)), dtype=np.float64)
"""CIE XYZ (D65) → linear Rec. 2020."""
