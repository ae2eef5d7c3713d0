"""Families of lamps as people know them, and the measured lamps of each."""

from __future__ import annotations

from fnmatch import fnmatchcase
from functools import cache

import numpy as np

from pipeline.arrays import Floats64
from pipeline.spectra.lights import black_body, daylight, packaged_light, packaged_lights

FAMILIES = {
    "incandescent": 0.20,
    "daylight": 0.15,
    "white LED": 0.30,
    "RGB LED": 0.10,
    "fluorescent": 0.15,
    "mercury or metal halide": 0.04,
    "sodium": 0.03,
    "xenon": 0.03,
}
"""How often each is met where people photograph, by estimate; they sum to 1."""

_NAMES = (
    ("incandescent", ("A", "SA", "*Incandescent", "60 A/W*")),
    ("daylight", ("C", "SC", "ID*")),
    ("white LED", ("LED-B*", "LED-V*", "Luxeon*", "PHOS-*", "Phosphor LED*")),
    ("RGB LED", ("LED-RGB*", "[34]-LED*")),
    ("sodium", ("HP1", "HP2", "*HPS*", "LPS")),
    ("mercury or metal halide", ("HP[345]", "*Mercury*", "Metal Halide", "MHC*")),
    ("xenon", ("Kinoton*",)),
    ("fluorescent", ("FL*", "* FL", "F[34]*", "T8*", "Philips TL*", "Thorn*", "Natural")),
)
"""Patterns of colour-science's names, the first that fits counts; D and ISO series are others."""
_BLACK_BODY_K = range(2000, 3600, 200)
_DAYLIGHT_K = (4000, 4500, 5000, 5500, 6000, 6500, 7500, 9000, 12000, 16000, 25000)


@cache
def family_spectra() -> dict[str, Floats64]:
    """Spectra (n, W) of the lamps of each of FAMILIES, each summing to 1.

    Those of colour-science and the flash tube by what their names say, black bodies for
    incandescent lamps, and CIE daylight.
    """
    found: dict[str, list[Floats64]] = {family: [] for family in FAMILIES}
    for name, spectrum in packaged_lights().items():
        family = family_of_name(name)
        if family:
            found[family].append(spectrum)
    found["incandescent"] += [black_body(kelvin) for kelvin in _BLACK_BODY_K]
    found["daylight"] += [daylight(kelvin) for kelvin in _DAYLIGHT_K]
    found["xenon"].append(packaged_light("xenon"))
    return {family: np.array(spectra) for family, spectra in found.items()}


def family_of_name(name: str) -> str | None:
    """Family of a light of colour-science, None for one that is no lamp or that repeats others."""
    for family, patterns in _NAMES:
        if any(fnmatchcase(name, pattern) for pattern in patterns):
            return family
    return None
