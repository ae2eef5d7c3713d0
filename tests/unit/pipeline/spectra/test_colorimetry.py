from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.spectra.colorimetry import camera_to_xyz
from pipeline.spectra.colour_science import colour_science
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.observer import cie_1931
from pipeline.spectra.wavelengths import WAVELENGTHS_NM, on_grid

colour = colour_science()


@pytest.fixture(scope="module")
def nikon() -> Floats64:
    table = colour.MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    return on_grid(table.wavelengths, table.values, "zero").T


@pytest.mark.parametrize(("light", "mean", "worst"), [("D65", 1.0, 3.5), ("A", 1.3, 5.0)])
def test_a_color_checker_through_a_measured_camera(
    nikon: Floats64, light: str, mean: float, worst: float
) -> None:
    """CIEDE2000 of the 24 patches between the camera's XYZ and the observer's."""
    illuminant = find_light(light)
    patches = colour.SDS_COLOURCHECKERS["BabelColor Average"].values()
    reflectances = np.array([on_grid(p.wavelengths, p.values, "hold") for p in patches])
    observer = cie_1931() * illuminant
    observer /= observer[1].sum()
    white = observer.sum(1)
    xy = colour.XYZ_to_xy(white)

    matrix = camera_to_xyz(nikon, illuminant, reflectance_spectra())
    seen = reflectances @ (nikon * illuminant).T @ matrix.T

    difference = colour.delta_E(
        colour.XYZ_to_Lab(seen, xy), colour.XYZ_to_Lab(reflectances @ observer.T, xy)
    )
    assert difference.mean() < mean
    assert difference.max() < worst
    np.testing.assert_allclose(matrix @ (nikon @ illuminant), white, rtol=1e-9)


def test_the_observer_itself_needs_no_more_than_a_scale() -> None:
    illuminant = find_light("D65")

    matrix = camera_to_xyz(cie_1931(), illuminant, reflectance_spectra())

    scale = 1 / (cie_1931()[1] @ illuminant)
    np.testing.assert_allclose(matrix, scale * np.eye(3), atol=1e-6 * scale)


def test_a_camera_of_two_colours_is_refused(nikon: Floats64) -> None:
    blind = nikon.copy()
    blind[2] = 0
    with pytest.raises(np.linalg.LinAlgError):
        camera_to_xyz(blind, find_light("D65"), reflectance_spectra())


def test_the_grid_is_that_of_the_observer() -> None:
    assert cie_1931().shape == (3, WAVELENGTHS_NM.size)
    assert WAVELENGTHS_NM[np.argmax(cie_1931()[1])] == 555
