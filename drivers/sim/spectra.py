"""Measured spectra of the simulated world, on one grid of wavelengths.

Camera: Nikon D5100, measured at the National Physical Laboratory (Darrodi et al. 2015). Lamps,
reflectances, D65 and the CIE 1931 observer: colour-science's datasets. Flash: see xenon.yaml.
"""

from __future__ import annotations

import warnings
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAKE = "NIKON CORPORATION"
MODEL = "NIKON D5100"

WAVELENGTHS_NM = np.arange(380.0, 781.0, 5.0)


@cache
def _colour() -> ModuleType:
    """colour-science, which takes two seconds to import and warns of plots nobody wants."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"(?s).*related API features are not available")
        import colour
    library: ModuleType = colour
    return library


@cache
def sensitivities() -> Array:
    """Look up the camera's sensitivities, (3, W), R, G, B."""
    table = _colour().MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    return np.stack([_sample(table.wavelengths, channel) for channel in table.values.T])


@cache
def observer() -> Array:
    """Look up the colour-matching functions of the CIE 1931 2° observer, (3, W), x̄, ȳ, z̄."""
    table = _colour().MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    return np.stack([_sample(table.wavelengths, channel) for channel in table.values.T])


@cache
def light(name: str) -> Array:
    """Look up a measured light source of colour-science by its name there, (W,), any scale."""
    return _spectrum(_colour().SDS_LIGHT_SOURCES[name])


@cache
def daylight() -> Array:
    """CIE D65, (W,), any scale."""
    return _spectrum(_colour().SDS_ILLUMINANTS["D65"])


@cache
def flash() -> Array:
    """Look up a measured xenon flash, (W,), any scale."""
    table = yaml.safe_load((Path(__file__).parent / "xenon.yaml").read_text(encoding="utf-8"))
    measured = np.arange(len(table["power"])) * table["step_nm"] + table["start_nm"]
    return _sample(measured, table["power"])


@cache
def reflectance(name: str) -> Array:
    """Look up a measured reflectance, (W,), 0…1.

    name: "chart/<patch>" for a ColorChecker patch, "training/<number>" for one of the 190 patches
    of the AMPAS training set.
    """
    source, _, entry = name.partition("/")
    if source == "chart":
        return _spectrum(_colour().SDS_COLOURCHECKERS["BabelColor Average"][entry])
    wavelengths, patches = _training()
    return _sample(wavelengths, patches[int(entry)])


@cache
def xyz_to_camera() -> Array:
    """Fit the 3×3 matrix from CIE XYZ to camera RGB to the training set under D65.

    Scaled as DNG wants it: a white card under D65 has Y = 1 and a largest response of 1.
    """
    wavelengths, patches = _training()
    lit = np.stack([_sample(wavelengths, patch) for patch in patches]) * daylight()
    xyz = lit @ observer().T / (daylight() @ observer()[1])
    rgb = lit @ sensitivities().T / (sensitivities() @ daylight()).max()
    return np.asarray(np.linalg.lstsq(xyz, rgb, rcond=None)[0].T)


@cache
def neutral() -> Array:
    """Camera RGB of a white card under D65, (3,), largest value 1."""
    response = sensitivities() @ daylight()
    return np.asarray(response / response.max())


@cache
def _training() -> tuple[Array, Array]:
    """Look up the AMPAS training set: wavelengths (w,), reflectances (190, w)."""
    table = _colour().characterisation.read_training_data_rawtoaces_v1()
    return table.wavelengths, table.values.T


def _spectrum(spectrum: Any) -> Array:
    return _sample(spectrum.wavelengths, spectrum.values)


def _sample(wavelengths: Any, values: Any) -> Array:
    return np.asarray(np.interp(WAVELENGTHS_NM, wavelengths, values))
