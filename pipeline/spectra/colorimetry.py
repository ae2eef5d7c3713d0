"""From camera RGB to the colours of the standard observer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.images.frames import Matrix
from pipeline.spectra.observer import cie_1931


def camera_to_xyz(
    sensitivities: NDArray[np.float64],
    illuminant: NDArray[np.float64],
    reflectances: NDArray[np.float64],
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
    inverse = np.linalg.inv(rgb.T @ rgb)
    free = (inverse @ rgb.T @ xyz).T
    pull = inverse @ white_rgb / (white_rgb @ inverse @ white_rgb)
    matrix: Matrix = free + np.outer(white_xyz - free @ white_rgb, pull)
    return matrix
