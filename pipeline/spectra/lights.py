"""Spectra of flashes, lamps and neutral lights."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.errors import OptionError
from pipeline.options import Spectrum
from pipeline.spectra.colorchecker import colorchecker_spectra
from pipeline.spectra.colour_science import colour_science, without_warnings
from pipeline.spectra.disk_cache import cached_on_disk
from pipeline.spectra.folder import folder_spectra, read_spectrum
from pipeline.spectra.names import key_of, unknown
from pipeline.spectra.tables import parse_spectrum
from pipeline.spectra.wavelengths import STEP_NM, WAVELENGTHS_NM, on_grid

_FLASHES = {"led": "LED-B5"}
"""Names of our own for lights of colour-science: a phosphor-converted white LED of 6500 K."""

_XENON = "xenon"
_DAYLIGHT = re.compile(r"d(\d{2,3})", re.IGNORECASE)
_DAYLIGHT_RANGE_K = (4000, 25000)  # for which CIE 015 defines daylight

_SENSITOMETRY = "ISO 7589"  # begins names of curves for tests of film, which are no lamps
_NO_LAMPS = ("E", "B")  # nor are the equal-energy spectrum and an obsolete filter
_MOST_POWER = 1e300  # what is more may have no finite sum
_NARROWEST_NM = 65.0  # width of an even spectrum as concentrated; narrower is near-monochromatic
_TWIN_COSINE = 0.9995  # between spectra that count as one


def find_light(request: str | Spectrum, purpose: str = "flash") -> Floats64:
    """Relative spectral power (W,) on WAVELENGTHS_NM, summing to 1.

    request: a table, "xenon" (a measured photographic flash), "led" (a phosphor white LED), a
    light of colour-science by name ("A", "FL2", "LED-B1", …), daylight by its temperature in
    hundreds of kelvin ("D65", "D58"), or a file of the user's folder.
    purpose: what messages call it ("flash", "neutral light"). Raises OptionError.
    """
    return look_up_light(request, purpose)()


def look_up_light(request: str | Spectrum, purpose: str = "flash") -> Callable[[], Floats64]:
    """Give what makes the spectrum of find_light, and raise the OptionError that it raises.

    Daylight, for which colour-science may have to be imported, is made only when that is called.
    """
    if isinstance(request, Spectrum):
        return _given(request, purpose)
    table = light_table(request)
    if table is not None:
        return _given(table, purpose)
    found = _look_up_packaged(request)
    if found is not None:
        return found
    names = [_XENON, *_FLASHES, *packaged_lights(), *_lights_of_folder()]
    raise OptionError(unknown(f"{purpose} spectrum", request, names))


def light_table(request: str | Spectrum) -> Spectrum | None:
    """Table that find_light is given, or finds in the user's folder; None for lights of its own.

    Raises OptionError for a file of the folder that cannot be used.
    """
    if isinstance(request, Spectrum):
        return request
    own = {key_of(name): paths for name, paths in folder_spectra().items()}
    paths = own.get(key_of(request))
    return None if paths is None else read_spectrum(paths, parse_spectrum)


def _given(table: Spectrum, purpose: str) -> Callable[[], Floats64]:
    if sum(table.power) > _MOST_POWER:
        raise OptionError(
            f"The {purpose} spectrum is too large to be added up: give its power relative to its "
            "largest."
        )
    spectrum = _normalised(on_grid(table.wavelength_nm, table.power, "hold"), purpose)
    return lambda: spectrum


def packaged_light(name: str) -> Floats64:
    """Spectrum (W,) that find_light has for a name without the user's folder, summing to 1.

    For what the program itself needs: no file of that name may change it. Raises KeyError.
    """
    found = _look_up_packaged(name)
    if found is None:
        raise KeyError(name)
    return found()


def _look_up_packaged(name: str) -> Callable[[], Floats64] | None:
    wanted = key_of(name)
    if wanted == _XENON:
        return _xenon
    entry = key_of(_FLASHES.get(wanted, name))
    for known, spectrum in packaged_lights().items():
        if key_of(known) == entry:
            return lambda: spectrum
    return _look_up_daylight(name)


@cache
def lamp_spectra() -> Floats64:
    """Spectra (n, W) of lamps to learn from, each summing to 1.

    The lamps of colour-science without near-monochromatic ones and near duplicates, black bodies
    of 2000 to 3800 K and daylight of 4000 to 10000 K.
    """
    candidates = [
        spectrum
        for name, spectrum in packaged_lights().items()
        if not name.startswith(_SENSITOMETRY) and name not in _NO_LAMPS
    ]
    candidates += [black_body(kelvin) for kelvin in range(2000, 4000, 300)]
    candidates += [daylight(kelvin) for kelvin in range(4000, 10001, 1000)]
    spectra = np.array(candidates)
    lengths = np.linalg.norm(spectra, axis=1)
    cosines = spectra @ spectra.T / np.outer(lengths, lengths)
    kept: list[int] = []
    for index in np.flatnonzero(STEP_NM / lengths**2 >= _NARROWEST_NM):
        if (cosines[index, kept] < _TWIN_COSINE).all():
            kept.append(int(index))
    return _frozen(spectra[kept])


@cache
@cached_on_disk
def reflectance_spectra() -> Floats64:
    """Reflectances (m, W), 0 to 1, to learn from.

    24 patches of the ColorChecker (average of BabelColor), 190 training patches of rawtoaces and
    the 99 evaluation samples of ANSI/IES TM-30 and CIE 2017.
    """
    colour = colour_science()
    shape = colour.SpectralShape(WAVELENGTHS_NM[0], WAVELENGTHS_NM[-1], STEP_NM)

    with without_warnings():
        from colour.characterisation import read_training_data_rawtoaces_v1
        from colour.quality.cfi2017 import load_TCS_CIE2017

        training = read_training_data_rawtoaces_v1()
        samples = load_TCS_CIE2017(shape)
    tables = [
        colorchecker_spectra(),
        on_grid(training.wavelengths, training.values, "hold").T,
        on_grid(samples.wavelengths, samples.values, "hold").T,
    ]
    return np.clip(np.concatenate(tables), 0.0, 1.0)


@cache
def _xenon() -> Floats64:
    table = files("pipeline.spectra") / "data" / "xenon_flash.csv"
    return find_light(parse_spectrum(table.read_bytes()))


@cache
def packaged_lights() -> dict[str, Floats64]:
    """Lights (W,) of colour-science by name, each summing to 1."""
    return dict(zip(_packaged_names().tolist(), _packaged_spectra(), strict=True))


@cached_on_disk
def _packaged_names() -> NDArray[np.str_]:
    return np.array([*_packaged()])


@cached_on_disk
def _packaged_spectra() -> Floats64:
    return np.array(
        [_unit(on_grid(table.wavelengths, table.values, "hold")) for table in _packaged().values()]
    )


def _packaged() -> dict[str, Any]:
    colour = colour_science()
    return {**colour.SDS_ILLUMINANTS, **colour.SDS_LIGHT_SOURCES}


def _look_up_daylight(name: str) -> Callable[[], Floats64] | None:
    match = _DAYLIGHT.fullmatch(name.strip())
    if match is None:
        return None
    kelvin = int(match[1]) * 100
    low, high = _DAYLIGHT_RANGE_K
    return partial(daylight, kelvin) if low <= kelvin <= high else None


@cached_on_disk
def black_body(kelvin: float) -> Floats64:
    """Black body (W,) of a temperature, summing to 1 (Planck)."""
    colour = colour_science()
    shape = colour.SpectralShape(WAVELENGTHS_NM[0], WAVELENGTHS_NM[-1], STEP_NM)
    with without_warnings():
        return _unit(colour.sd_blackbody(kelvin, shape).values)


@cached_on_disk
def daylight(kelvin: float) -> Floats64:
    """CIE daylight (W,) of a nominal temperature (CIE 15:2018, corrected by 1.4388/1.4380)."""
    colour = colour_science()
    with without_warnings():
        xy = colour.temperature.CCT_to_xy_CIE_D(kelvin * 1.4388 / 1.4380)
        table = colour.sd_CIE_illuminant_D_series(xy)
    return _unit(on_grid(table.wavelengths, table.values, "hold"))


def _lights_of_folder() -> list[str]:
    names = []
    for name, paths in folder_spectra().items():
        with suppress(OptionError):  # a camera's table, or none
            read_spectrum(paths, parse_spectrum)
            names.append(name)
    return names


def _normalised(power: Floats64, purpose: str) -> Floats64:
    if not power.sum() > 0:
        raise OptionError(f"The {purpose} spectrum is zero from 380 to 780 nm: check its units.")
    return _unit(power)


def _unit(power: Floats64) -> Floats64:
    return _frozen(power / power.sum())


def _frozen(values: Floats64) -> Floats64:
    values.setflags(write=False)
    return values
