"""From camera RGB to the colours of the standard observer."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Matrix
from pipeline.spectra.observer import cie_1931


def camera_to_xyz(
    sensitivities: Floats64,
    illuminant: Floats64,
    reflectances: Floats64,
) -> Matrix:
    """Matrix (3, 3) from camera RGB under an illuminant to CIE XYZ, learnt from reflectances.

    sensitivities (3, W), illuminant (W,), reflectances (m, W). Camera RGB of a reflectance ρ is
    sensitivities @ (illuminant·ρ), taken as it is; XYZ has Y = 1 for the perfect white. Least
    squares with the white kept exact (Finlayson and Drew 1997, white-point preserving least
    squares). The camera must see three colours under the illuminant: else the matrix is rounding
    noise, or numpy.linalg.LinAlgError is raised.
    """
    observer = cie_1931() * illuminant
    observer /= observer[1].sum()
    camera = sensitivities * illuminant
    white_rgb, white_xyz = camera.sum(axis=1), observer.sum(axis=1)
    rgb, xyz = reflectances @ camera.T, reflectances @ observer.T
    return white_preserving(rgb, xyz, white_rgb, white_xyz)


def white_preserving(
    seen: Floats64,
    wanted: Floats64,
    white: Floats64,
    wanted_white: Floats64,
) -> Matrix:
    """Matrix (3, 3) that takes colours seen (m, 3) nearest to those wanted, and white exactly.

    white, wanted_white: (3,). White-point preserving least squares (Finlayson and Drew 1997).
    Raises numpy.linalg.LinAlgError where the colours seen do not differ in three ways.
    """
    inverse = np.linalg.inv(seen.T @ seen)
    free = (inverse @ seen.T @ wanted).T
    pull = inverse @ white / (white @ inverse @ white)
    matrix: Matrix = free + np.outer(wanted_white - free @ white, pull)
    return matrix
