from __future__ import annotations

import numpy as np
import pytest

from pipeline.spectra.families import FAMILIES, family_of_name, family_spectra
from pipeline.spectra.lights import black_body, daylight, find_light, packaged_lights


def test_families_are_met_with_probabilities() -> None:
    assert sum(FAMILIES.values()) == pytest.approx(1)
    assert max(FAMILIES, key=lambda family: FAMILIES[family]) == "white LED"


@pytest.mark.parametrize(
    ("name", "family"),
    [
        ("A", "incandescent"),
        ("Neodimium Incandescent", "incandescent"),
        ("C", "daylight"),
        ("ID65", "daylight"),
        ("LED-B1", "white LED"),
        ("LED-BH1", "white LED"),
        ("LED-RGB1", "RGB LED"),
        ("3-LED-2 Yellow", "RGB LED"),
        ("4-LED No Yellow", "RGB LED"),
        ("HP1", "sodium"),
        ("LPS", "sodium"),
        ("SDW-T 100W/LV (Super HPS)", "sodium"),
        ("HP3", "mercury or metal halide"),
        ("H38JA-100/DX (Mercury DX)", "mercury or metal halide"),
        ("MHC100/U/MP/4K", "mercury or metal halide"),
        ("Kinoton 75P", "xenon"),
        ("FL2", "fluorescent"),
        ("FL3.15", "fluorescent"),
        ("Daylight FL", "fluorescent"),
        ("F32T8/TL830 (Triphosphor)", "fluorescent"),
        ("T8 Polylux 3000", "fluorescent"),
        ("Philips TL-84", "fluorescent"),
        ("E", None),
        ("B", None),
        ("D65", None),
        ("ISO 7589 Photoflood", None),
    ],
)
def test_a_name_tells_the_family(name: str, family: str | None) -> None:
    assert name in packaged_lights()
    assert family_of_name(name) == family


def test_every_lamp_of_the_library_has_a_family() -> None:
    without = {name for name in packaged_lights() if family_of_name(name) is None}
    assert {name.split()[0] for name in without} == {
        "B",
        "D50",
        "D55",
        "D60",
        "D65",
        "D75",
        "E",
        "ISO",
    }


def test_spectra_are_those_of_the_families() -> None:
    found = family_spectra()

    assert list(found) == list(FAMILIES)
    assert all(spectra.shape[1] == 81 for spectra in found.values())
    np.testing.assert_allclose(np.concatenate(list(found.values())).sum(axis=1), 1)
    for name, family in (("A", "incandescent"), ("D65", "daylight"), ("xenon", "xenon")):
        nearest = np.abs(found[family] - find_light(name)).max(axis=1).min()
        assert nearest < 1e-4


def test_bulbs_and_skies_of_all_temperatures_are_among_them() -> None:
    found = family_spectra()
    warm = [("incandescent", black_body(kelvin)) for kelvin in (2000, 2600, 3400)]
    for family, light in (*warm, ("daylight", daylight(4000)), ("daylight", daylight(25000))):
        assert np.abs(found[family] - light).max(axis=1).min() < 1e-9
