"""Colour spaces of the files we write, and the way there from camera RGB."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.frames import Matrix
from pipeline.spectra.observer import cie_1931

Primaries = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]

SRGB_PRIMARIES: Primaries = ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060))
"""CIE xy of red, green and blue, IEC 61966-2-1 (as Rec. ITU-R BT.709)."""
REC2020_PRIMARIES: Primaries = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046))
"""CIE xy of red, green and blue, Rec. ITU-R BT.2020."""
D65_XY = (0.3127, 0.3290)
"""White of both spaces."""

CCT_RANGE_K = (1000.0, 15000.0)
_MAX_DUV = 0.05
"""Farther than this from the Planckian locus a colour has no CCT (CIE 15:2018)."""


def xy_to_xyz(xy: tuple[float, float]) -> NDArray[np.float64]:
    """CIE xy → XYZ with Y = 1."""
    x, y = xy
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def rgb_to_xyz(primaries: Primaries, white: tuple[float, float] = D65_XY) -> Matrix:
    """Matrix (3, 3) from linear RGB to CIE XYZ, white (1, 1, 1) → Y = 1 (SMPTE RP 177)."""
    columns = np.array([xy_to_xyz(xy) for xy in primaries]).T
    matrix: Matrix = columns * np.linalg.solve(columns, xy_to_xyz(white))
    return matrix


XYZ_TO_SRGB: Matrix = np.asarray(np.linalg.inv(rgb_to_xyz(SRGB_PRIMARIES)), dtype=np.float64)
"""CIE XYZ (D65) → linear sRGB."""
XYZ_TO_REC2020: Matrix = np.asarray(np.linalg.inv(rgb_to_xyz(REC2020_PRIMARIES)), dtype=np.float64)
"""CIE XYZ (D65) → linear Rec. 2020."""


def camera_to_xyz(
    sensitivities: NDArray[np.float64],
    illuminant: NDArray[np.float64],
    reflectances: NDArray[np.float64],
) -> Matrix:
    """Matrix (3, 3) from camera RGB under an illuminant to CIE XYZ, learnt from reflectances.

    sensitivities (3, W), illuminant (W,), reflectances (m, W). Camera RGB of a reflectance ρ is
    sensitivities @ (illuminant·ρ), taken as it is; XYZ has Y = 1 for the perfect white. Least
    squares with the white kept exact (Finlayson and Drew 1997, white-point preserving least
    squares). Raises numpy.linalg.LinAlgError where the camera does not see three colours.
    """
    observer = cie_1931() * illuminant
    observer /= observer[1].sum()
    camera = sensitivities * illuminant
    white_rgb, white_xyz = camera.sum(axis=1), observer.sum(axis=1)
    rgb, xyz = reflectances @ camera.T, reflectances @ observer.T
    inverse = np.linalg.inv(rgb.T @ rgb)
    free = (inverse @ rgb.T @ xyz).T
    pull = inverse @ white_rgb / (white_rgb @ inverse @ white_rgb)
    matrix: Matrix = free + np.outer(white_xyz - free @ white_rgb, pull)
    return matrix


def cct(rgb: ArrayLike, matrix: Matrix) -> float | None:
    """Correlated colour temperature in kelvin of a camera RGB.

    matrix: camera RGB → CIE XYZ. None for a colour more than 0.05 (CIE 1960 uv) off the Planckian
    locus or outside CCT_RANGE_K. The locus is Krystek's (1985) approximation.
    """
    X, Y, Z = matrix @ np.asarray(rgb, dtype=np.float64)
    total = X + 15 * Y + 3 * Z
    if not total > 0:
        return None
    point = np.array([4 * X, 6 * Y]) / total
    low, high = (1e6 / kelvin for kelvin in reversed(CCT_RANGE_K))
    for _ in range(4):  # each round looks ten times as closely in reciprocal temperature
        mired = np.linspace(low, high, 201)
        distance = np.hypot(*(_planckian_uv(1e6 / mired) - point[:, None]))
        best = int(np.argmin(distance))
        if best in (0, mired.size - 1) or distance[best] > _MAX_DUV:
            return None
        low, high = mired[best - 1], mired[best + 1]
    return float(1e6 / mired[best])


def _planckian_uv(kelvin: NDArray[np.float64]) -> NDArray[np.float64]:
    """CIE 1960 uv (2, n) of black bodies, Krystek 1985, 1000 to 15000 K."""
    T = kelvin
    u = (0.860117757 + 1.54118254e-4 * T + 1.28641212e-7 * T**2) / (
        1 + 8.42420235e-4 * T + 7.08145163e-7 * T**2
    )
    v = (0.317398726 + 4.22806245e-5 * T + 4.20481691e-8 * T**2) / (
        1 - 2.89741816e-5 * T + 1.61456053e-7 * T**2
    )
    return np.array([u, v])
