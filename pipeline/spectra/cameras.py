"""Which spectral sensitivities describe the camera that took a frame."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from typing import Literal

import numpy as np

from pipeline.arrays import Floats64
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.errors import OptionError
from pipeline.images.frames import Frame
from pipeline.options import Sensitivities
from pipeline.spectra.colorimetry import camera_to_xyz
from pipeline.spectra.colour_science import colour_science, without_warnings
from pipeline.spectra.disk_cache import cached_on_disk
from pipeline.spectra.folder import folder_spectra, read_spectrum
from pipeline.spectra.lights import packaged_light, reflectance_spectra
from pipeline.spectra.names import key_of, unknown
from pipeline.spectra.tables import parse_sensitivities
from pipeline.spectra.wavelengths import on_grid
from pipeline.taken_with import TakenWith

_PACKAGED = {"Nikon D5100": "Nikon 5100 (NPL)", "Sigma SD1 Merrill": "Sigma SDMerill (NPL)"}
"""Cameras measured in colour-science: their proper names and its own."""

_MIN_INDEPENDENCE = 0.01  # least ÷ largest singular value; cameras have 0.09 and more


@dataclass(frozen=True)
class Camera:
    """A camera's spectral sensitivities.

    sensitivities: float64 (3, W) for R, G, B on WAVELENGTHS_NM, the largest value 1. The ratio of
    the channels is as measured, where the measurement kept it.
    source: "measured" (a known camera), "file" (a table handed in), "approximate" (from the
    colour matrix) or "stand-in" (a picture rendered to sRGB, whose functions may be negative, or a
    sensor of which nothing is known). in_srgb: whether it is that picture's.
    taken_with: the photographs that a calibration found it with, None for others.
    """

    name: str
    sensitivities: Floats64
    source: Literal["measured", "file", "approximate", "stand-in"]
    in_srgb: bool = False
    taken_with: TakenWith | None = None

    @property
    def approximate(self) -> bool:
        """Whether the sensitivities are not the camera's own."""
        return self.source in ("approximate", "stand-in")


def find_camera(request: str | Sensitivities | None, frame: Frame) -> Camera:
    """Sensitivities asked for, or those that fit the frame best.

    A table or a name settles it. Else a frame of sensor or linear values gets its measured camera
    by EXIF make and model, or by a model that says the brand itself, since the make may be another
    firm's name ("RICOH IMAGING COMPANY, LTD." of a "PENTAX K-3"); or its colour matrix × the XYZ
    functions of a sensor, or, of a sensor without a matrix of use, a typical sensor. Everything
    else, and linear values whose file says by its profile what colours they are, is taken as
    rendered to sRGB, where white balance and matrix have been applied already and the sensor's own
    sensitivities do not describe the values any more.
    Raises OptionError for an unknown name.
    """
    if request is not None:
        return named_camera(request)
    name = f"{frame.make} {frame.model}".strip()
    if not frame.in_colour_space and name:
        camera = _measured(name) or _measured(frame.model, whole=True)
        if camera is not None:
            return camera
    if frame.encoding != "raw":
        return srgb_stand_in()
    if frame.xyz_to_camera is None:
        return typical_sensor()
    functions = np.maximum(frame.xyz_to_camera @ _sensor_xyz(), 0.0)
    if not tells_colours_apart(functions):  # a matrix of no camera, as one of negative numbers
        return typical_sensor()
    return Camera(name or "camera", _scaled(functions), "approximate")


def named_camera(request: str | Sensitivities) -> Camera:
    """Camera of a table, or measured one of a name. Raises OptionError.

    A name may be with or without the make, and that of a file of the user's folder.
    """
    if isinstance(request, Sensitivities):
        return camera_from_table("table", request, "file")
    camera = _measured(request)
    if camera is None:
        names = [camera.name for camera in measured_cameras()]  # lights have tables, too
        raise OptionError(unknown("camera", request, names))
    return camera


def tells_colours_apart(sensitivities: Floats64) -> bool:
    """Whether sensitivities (3, W) are three, of which none nearly is a mixture of the others."""
    values = np.linalg.svd(sensitivities, compute_uv=False)
    return bool(values[2] > _MIN_INDEPENDENCE * values[0])


def measured_cameras() -> list[Camera]:
    """All cameras of which sensitivities were measured: the packaged and those of the folder."""
    cameras = [_measured_by_colour(name) for name in _PACKAGED]
    for name, paths in folder_spectra().items():
        with suppress(OptionError):  # a light's table, or none
            cameras.append(read_spectrum(paths, partial(_camera_of_folder, name)))
    return cameras


def camera_from_table(
    name: str, table: Sensitivities, source: Literal["measured", "file"]
) -> Camera:
    """Camera of a table. Raises OptionError where it is zero in a channel."""
    columns = np.array([table.r, table.g, table.b]).T
    values = on_grid(table.wavelength_nm, columns, outside="zero").T
    if not (values.max(axis=1) > 0).all():
        raise OptionError(
            "The camera table is zero from 380 to 780 nm: give its wavelengths in nm."
        )
    return Camera(name, _scaled(values), source, taken_with=table.taken_with)


@cache
def srgb_stand_in() -> Camera:
    """Sensitivities that stand for a picture rendered to sRGB.

    A camera's rendering is white balance and a matrix on what its sensor saw, so the functions
    are those of a sensor brought to sRGB, and keep their negative parts. In renderings of 48
    measured cameras the invariant of one lamp then differs by 2.0° between surfaces (median); with
    the negative parts cut off by 5.0°, with the CIE observer in place of the sensor by 3.4°.
    """
    return Camera("sRGB", _scaled(XYZ_TO_SRGB @ _sensor_xyz()), "stand-in", in_srgb=True)


@cache
def typical_sensor() -> Camera:
    """Sensitivities that stand for a sensor of which nothing is known: those of the Nikon D5100."""
    return Camera("typical sensor", _measured_by_colour("Nikon D5100").sensitivities, "stand-in")


def balanced(camera: Camera) -> Camera:
    """Return a camera with its channels multiplied until a white card in daylight is white."""
    sensor = camera.sensitivities
    sensitivities = _scaled(sensor / (sensor @ packaged_light("D65"))[:, None])
    return Camera(f"{camera.name}, balanced for daylight", sensitivities, "stand-in")


@cache
def _sensor_xyz() -> Floats64:
    """CIE XYZ functions (3, W) as nearly as a real sensor has them: those of the Nikon D5100.

    Cameras resemble each other more than the CIE observer. Over 48 measured cameras, with LibRaw's
    matrices of them, a lamp's place on the sphere of invariants is off by 0.8° with these
    functions and by 2.1° with the observer's own (medians; known sensitivities: 0.3°).
    """
    camera = typical_sensor().sensitivities
    return camera_to_xyz(camera, packaged_light("D65"), reflectance_spectra()) @ camera


def _measured(name: str, whole: bool = False) -> Camera | None:
    """Camera of that name, with or without its make, from the user's folder or the packaged.

    whole: the name says the make, too.
    """
    wanted = key_of(name)
    for known, paths in folder_spectra().items():
        if wanted in _keys(known, whole):
            return read_spectrum(paths, partial(_camera_of_folder, known))
    for known, entry in _PACKAGED.items():
        if wanted in _keys(known, whole) or wanted == key_of(entry):
            return _measured_by_colour(known)
    return None


def _camera_of_folder(name: str, data: bytes) -> Camera:
    return camera_from_table(name, parse_sensitivities(data), "measured")


def _measured_by_colour(name: str) -> Camera:
    return Camera(name, _scaled(_packaged_sensitivities(name)), "measured")


@cached_on_disk
def _packaged_sensitivities(name: str) -> Floats64:
    with without_warnings():
        table = colour_science().MSDS_CAMERA_SENSITIVITIES[_PACKAGED[name]]
    return np.asarray(on_grid(table.wavelengths, table.values, outside="zero").T)


def _keys(name: str, whole: bool) -> set[str]:
    """Keys a camera answers to: with its make, and by its model alone unless whole."""
    model = "" if whole else key_of(name.partition(" ")[2])
    return {key_of(name), model} - {""}


def _scaled(sensitivities: Floats64) -> Floats64:
    scaled: Floats64 = sensitivities / sensitivities.max()
    scaled.setflags(write=False)
    return scaled
