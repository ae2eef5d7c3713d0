from __future__ import annotations

import pytest
from numpy.typing import ArrayLike

from pipeline.colour.temperature import CCT_RANGE_K, cct_duv, white_of
from pipeline.spectra.colour_science import colour_science
from pipeline.spectra.lights import find_light
from pipeline.spectra.observer import cie_1931

colour = colour_science()


def cct(xyz: ArrayLike) -> float | None:
    found = cct_duv(xyz)
    return None if found is None else found[0]


@pytest.mark.parametrize(
    ("light", "kelvin"),
    [("A", 2856), ("D50", 5003), ("D55", 5503), ("D65", 6504), ("D75", 7504)],
)
def test_cct_of_standard_illuminants(light: str, kelvin: float) -> None:
    xyz = cie_1931() @ find_light(light)

    assert cct(xyz) == pytest.approx(kelvin, rel=0.005)


@pytest.mark.parametrize("kelvin", [1200, 1800, 2700, 3500, 4500, 6500, 9000, 14000])
def test_cct_of_black_bodies(kelvin: float) -> None:
    shape = colour.SpectralShape(380, 780, 5)
    xyz = cie_1931() @ colour.sd_blackbody(kelvin, shape).values

    assert cct(xyz) == pytest.approx(kelvin, rel=0.01)


@pytest.mark.parametrize("light", ["FL2", "FL7", "FL11", "LED-B1", "LED-B4", "HP1"])
def test_cct_of_lamps_agrees_with_an_independent_method(light: str) -> None:
    xyz = cie_1931() @ find_light(light)
    uv = colour.UCS_to_uv(colour.XYZ_to_UCS(xyz))

    assert cct(xyz) == pytest.approx(colour.uv_to_CCT(uv, "Ohno 2013")[0], rel=0.01)


@pytest.mark.parametrize(
    "xyz",
    [(0, 0, 0), (-1, -1, -1), (0.1, 0.9, 0.1), (0.6, 0.2, 0.9), (0.2, 0.1, 3.0), (1, 0.3, 0)],
    ids=["black", "negative", "green", "purple", "blue", "red"],
)
def test_colours_far_from_any_black_body_have_no_cct(xyz: tuple[float, float, float]) -> None:
    assert cct(xyz) is None


@pytest.mark.parametrize("duv", [-0.02, 0.0, 0.02])
@pytest.mark.parametrize("kelvin", [1000, 1001, 1003, 14500, 14700, 14990, 15000])
def test_cct_is_known_up_to_both_ends_of_the_range(kelvin: float, duv: float) -> None:
    found = cct_duv(white_of(kelvin, duv))

    assert found is not None
    assert found[0] == pytest.approx(kelvin, rel=2e-3)
    assert CCT_RANGE_K[0] <= found[0] <= CCT_RANGE_K[1]
    assert found[1] == pytest.approx(duv, abs=1e-4)


@pytest.mark.parametrize("kelvin", [997, 15100, 16000])
def test_lights_just_beyond_the_range_have_no_cct(kelvin: float) -> None:
    assert cct_duv(white_of(kelvin, 0)) is None


@pytest.mark.parametrize("kelvin", [900, 20000])
def test_black_bodies_beyond_the_range_have_no_cct(kelvin: float) -> None:
    shape = colour.SpectralShape(380, 780, 5)

    assert cct(cie_1931() @ colour.sd_blackbody(kelvin, shape).values) is None


@pytest.mark.parametrize(("duv", "known"), [(0.04, True), (0.06, False)])
def test_colours_off_the_locus_have_a_cct_up_to_a_distance(duv: float, known: bool) -> None:
    """Straight up in CIE 1960 uv from the black body of 4000 K, where the locus is nearly level."""
    u, v = colour.CCT_to_uv([4000, duv], "Ohno 2013")
    xyz = colour.xy_to_XYZ(colour.UCS_uv_to_xy([u, v]))

    assert (cct(xyz) is not None) == known


@pytest.mark.parametrize("kelvin", [2200, 3000, 4000, 6500, 10000])
@pytest.mark.parametrize("duv", [-0.03, -0.01, 0.0, 0.006, 0.02])
def test_duv_agrees_with_an_independent_method(kelvin: float, duv: float) -> None:
    u, v = colour.CCT_to_uv([kelvin, duv], "Ohno 2013")
    xyz = colour.xy_to_XYZ(colour.UCS_uv_to_xy([u, v]))

    found = cct_duv(xyz)

    assert found is not None
    assert found[0] == pytest.approx(kelvin, rel=0.01)
    assert found[1] == pytest.approx(duv, abs=0.0005)


@pytest.mark.parametrize(("light", "duv"), [("D65", 0.0032), ("A", 0.0), ("FL2", 0.0018)])
def test_duv_of_standard_illuminants(light: str, duv: float) -> None:
    found = cct_duv(cie_1931() @ find_light(light))

    assert found is not None
    assert found[1] == pytest.approx(duv, abs=0.0008)


@pytest.mark.parametrize("kelvin", [1600, 2856, 6504, 12000])
@pytest.mark.parametrize("duv", [-0.03, 0.0, 0.01])
def test_the_white_of_a_temperature_has_it(kelvin: float, duv: float) -> None:
    white = white_of(kelvin, duv)

    found = cct_duv(white)

    assert white[1] == 1.0
    assert found is not None
    assert found[0] == pytest.approx(kelvin, rel=2e-3)
    assert found[1] == pytest.approx(duv, abs=2e-5)
