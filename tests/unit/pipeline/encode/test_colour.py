"""Colour spaces against the numbers of their standards and of colour-science."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.encode.colour import (
    REC2020_PRIMARIES,
    SRGB_PRIMARIES,
    XYZ_TO_SRGB,
    camera_to_xyz,
    cct,
    rgb_to_xyz,
)
from pipeline.spectra.grid import WAVELENGTHS_NM, on_grid
from pipeline.spectra.library import colour_science
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.observer import cie_1931

colour = colour_science()


def test_the_matrix_of_srgb_is_that_of_the_standard() -> None:
    """IEC 61966-2-1, table of 4 decimals."""
    expected = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    np.testing.assert_allclose(rgb_to_xyz(SRGB_PRIMARIES), expected, atol=1e-4)


def test_the_matrix_of_rec2020_is_that_of_the_standard() -> None:
    """Rec. ITU-R BT.2020, luminance weights, and BT.2087, table of 4 decimals."""
    expected = [[0.6370, 0.1446, 0.1689], [0.2627, 0.6780, 0.0593], [0.0000, 0.0281, 1.0610]]
    np.testing.assert_allclose(rgb_to_xyz(REC2020_PRIMARIES), expected, atol=1e-4)


@pytest.mark.parametrize(
    ("light", "kelvin"),
    [("A", 2856), ("D50", 5003), ("D55", 5503), ("D65", 6504), ("D75", 7504)],
)
def test_cct_of_standard_illuminants(light: str, kelvin: float) -> None:
    xyz = cie_1931() @ find_light(light)

    assert cct(xyz, np.eye(3)) == pytest.approx(kelvin, rel=0.005)


@pytest.mark.parametrize("kelvin", [1200, 1800, 2700, 3500, 4500, 6500, 9000, 14000])
def test_cct_of_black_bodies(kelvin: float) -> None:
    shape = colour.SpectralShape(380, 780, 5)
    xyz = cie_1931() @ colour.sd_blackbody(kelvin, shape).values

    assert cct(xyz, np.eye(3)) == pytest.approx(kelvin, rel=0.01)


@pytest.mark.parametrize("light", ["FL2", "FL7", "FL11", "LED-B1", "LED-B4", "HP1"])
def test_cct_of_lamps_agrees_with_an_independent_method(light: str) -> None:
    xyz = cie_1931() @ find_light(light)
    uv = colour.UCS_to_uv(colour.XYZ_to_UCS(xyz))

    assert cct(xyz, np.eye(3)) == pytest.approx(colour.uv_to_CCT(uv, "Ohno 2013")[0], rel=0.01)


@pytest.mark.parametrize(
    "xyz",
    [(0, 0, 0), (-1, -1, -1), (0.1, 0.9, 0.1), (0.6, 0.2, 0.9), (0.2, 0.1, 3.0), (1, 0.3, 0)],
    ids=["black", "negative", "green", "purple", "blue", "red"],
)
def test_colours_far_from_any_black_body_have_no_cct(xyz: tuple[float, float, float]) -> None:
    assert cct(xyz, np.eye(3)) is None


def test_cct_goes_through_the_matrix() -> None:
    xyz = cie_1931() @ find_light("A")
    camera = np.array([[0.5, 0.2, 0.1], [0.1, 0.9, 0.0], [0.0, 0.2, 0.8]])

    assert cct(camera @ xyz, np.linalg.inv(camera)) == pytest.approx(2856, rel=0.005)


@pytest.fixture(scope="module")
def nikon() -> NDArray[np.float64]:
    table = colour.MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    return on_grid(table.wavelengths, table.values, "zero").T


@pytest.mark.parametrize(("light", "mean", "worst"), [("D65", 1.0, 3.5), ("A", 1.3, 5.0)])
def test_a_color_checker_through_a_measured_camera(
    nikon: NDArray[np.float64], light: str, mean: float, worst: float
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


def test_white_of_srgb_is_d65() -> None:
    white = cie_1931() @ find_light("D65")
    rgb = XYZ_TO_SRGB @ (white / white[1])
    np.testing.assert_allclose(rgb, 1.0, atol=0.002)


def test_a_camera_of_two_colours_is_refused(nikon: NDArray[np.float64]) -> None:
    blind = nikon.copy()
    blind[2] = 0
    with pytest.raises(np.linalg.LinAlgError):
        camera_to_xyz(blind, find_light("D65"), reflectance_spectra())


def test_the_grid_is_that_of_the_observer() -> None:
    assert cie_1931().shape == (3, WAVELENGTHS_NM.size)
    assert WAVELENGTHS_NM[np.argmax(cie_1931()[1])] == 555
