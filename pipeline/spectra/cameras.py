"""Which spectral sensitivities describe the camera that took a frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.encode.colour import XYZ_TO_SRGB
from pipeline.errors import OptionError
from pipeline.frames import Frame
from pipeline.options import Sensitivities
from pipeline.spectra.folder import folder_spectra
from pipeline.spectra.grid import on_grid
from pipeline.spectra.library import colour_science, without_warnings
from pipeline.spectra.names import key_of, unknown
from pipeline.spectra.observer import cie_1931
from pipeline.spectra.tables import parse_sensitivities

_PACKAGED = {"Nikon D5100": "Nikon 5100 (NPL)", "Sigma SD1 Merrill": "Sigma SDMerill (NPL)"}
"""Cameras measured in colour-science: their proper names and its own."""


@dataclass(frozen=True)
class Camera:
    """A camera's spectral sensitivities.

    sensitivities: float64 (3, W) for R, G, B on WAVELENGTHS_NM, the largest value 1. The ratio of
    the channels is as measured, where the measurement kept it.
    source: "measured" (a known camera), "file" (a table handed in), "approximate" (colour matrix
    × CIE functions) or "stand-in" (a picture rendered to sRGB).
    """

    name: str
    sensitivities: NDArray[np.float64]
    source: Literal["measured", "file", "approximate", "stand-in"]


def find_camera(request: str | Sensitivities | None, frame: Frame) -> Camera:
    """Sensitivities asked for, or those that fit the frame best.

    A table or a name settles it. Else a frame of sensor or linear values gets its measured camera
    by EXIF make and model, or its colour matrix × the CIE 1931 functions; everything else is
    taken as rendered to sRGB, where white balance and matrix have been applied already and the
    sensor's own sensitivities do not describe the values any more.
    Raises OptionError for an unknown name.
    """
    if isinstance(request, Sensitivities):
        return _from_table("table", request, "file")
    if request is not None:
        camera = _measured(request)
        if camera is None:
            raise OptionError(unknown("camera", request, [*_PACKAGED, *folder_spectra()]))
        return camera
    name = f"{frame.make} {frame.model}".strip()
    if frame.encoding != "srgb" and name:
        camera = _measured(name)
        if camera is not None:
            return camera
    if frame.encoding == "raw" and frame.xyz_to_camera is not None:
        functions = frame.xyz_to_camera @ cie_1931()
        return Camera(name or "camera", _scaled(np.maximum(functions, 0.0)), "approximate")
    return srgb_stand_in()


@cache
def srgb_stand_in() -> Camera:
    """Sensitivities that stand for a picture rendered to sRGB."""
    return Camera("sRGB", _scaled(np.maximum(XYZ_TO_SRGB @ cie_1931(), 0.0)), "stand-in")


def _measured(name: str) -> Camera | None:
    """Camera of that name, with or without its make, from the user's folder or the packaged."""
    wanted = key_of(name)
    for known, path in folder_spectra().items():
        if wanted in _keys(known):
            return _from_table(known, parse_sensitivities(path.read_bytes()), "measured")
    for known, entry in _PACKAGED.items():
        if wanted in _keys(known) or wanted == key_of(entry):
            with without_warnings():
                table = colour_science().MSDS_CAMERA_SENSITIVITIES[entry]
            values = on_grid(table.wavelengths, table.values, outside="zero").T
            return Camera(known, _scaled(values), "measured")
    return None


def _keys(name: str) -> set[str]:
    """Keys a camera answers to: with its make, and by its model alone."""
    return {key_of(name), key_of(name.partition(" ")[2])} - {""}


def _from_table(name: str, table: Sensitivities, source: Literal["measured", "file"]) -> Camera:
    columns = np.array([table.r, table.g, table.b]).T
    values = on_grid(table.wavelength_nm, columns, outside="zero").T
    if not (values.max(axis=1) > 0).all():
        raise OptionError(
            "The camera table is zero from 380 to 780 nm: give its wavelengths in nm."
        )
    return Camera(name, _scaled(values), source)


def _scaled(sensitivities: NDArray[np.float64]) -> NDArray[np.float64]:
    scaled: NDArray[np.float64] = sensitivities / sensitivities.max()
    scaled.setflags(write=False)
    return scaled
