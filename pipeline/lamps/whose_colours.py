"""Whose colours files hold: of a camera that nobody names, or really of the one that is named."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Floats64
from pipeline.errors import UnusablePairError
from pipeline.images.frames import Frame
from pipeline.lamps.lamps import MIN_PIXELS
from pipeline.light.model import Model
from pipeline.matrixfit.contrasts import MANY
from pipeline.matrixfit.evidence import Evidence, gather_evidence
from pipeline.matrixfit.fit import MOST_LAMPS, FitInput, first_fit
from pipeline.matrixfit.known import nothing_known
from pipeline.options import LampCount
from pipeline.pair.reduced import ReducedPair
from pipeline.run_warnings import Code, RunWarning
from pipeline.spectra.cameras import Camera, balanced, find_camera, srgb_stand_in, typical_sensor
from pipeline.spectra.lights import reflectance_spectra

_TELLING_LAMPS = 2  # one lamp leaves the outline to chance, and any camera explains it
_PRIOR_WEIGHT = 0.2  # the prior is narrower than measured, for other reasons
# Chosen on development rooms (docs/trials/whose_colours.md)
_SENSOR_LIKELIER, _SRGB_LIKELIER = 60.0, 90.0
_LIKELIER_UNDER_ONE = 200.0
_BETTER_RENDERED = (
    " Where the camera gives none, lock its white balance for both at flash or daylight, and "
    "choose a rendering without HDR, added contrast and strong colours."
)
"""How a warning of renderings goes on: what they lose most by (docs/trials/renderings.md)."""

_NOT_ITS_VALUES = (
    " The camera named describes the values of its sensor, which these are not: leave it out."
)
"""What a warning of files that hold no sensor's values goes on with where a camera was named."""

_WITHOUT_CONTRAST = (
    " A contrast that the camera put on them was found and taken off, so that layers and pictures "
    "are flatter than the files."
)
"""How it goes on where the pair told the camera's curve."""


def names_no_camera(camera: Camera, frame: Frame) -> bool:
    """Whether nothing but the pixels tells whose colours a frame holds."""
    return frame.undeclared and camera.in_srgb


def likely_camera(
    reduced: ReducedPair,
    flash: Floats64,
    requested: LampCount,
    sensor: Camera | None,
    build: Callable[[Camera], Model],
) -> Camera:
    """Choose what explains linear files best: linear sRGB, or the values of a sensor.

    Converters write either, and hardly ever say which. Lamps are fitted with both, and the likelier
    fit tells (docs/decisions/0031-whose-colours.md): two and three lamps where the number is to be
    found, else as many as are asked for, two at least. The sensor's values may be as it gave them
    or balanced for daylight: tried is the one whose colours under the flash are more like the
    pair's.

    flash: (W,) its spectrum. sensor: of the camera that EXIF names, None where it names none that
    was measured. It speaks for the sensor's values, so that sRGB must be much likelier, and
    the scene have edges of shadows. build: the model of a camera.
    """
    if requested == "auto":
        numbers = [_TELLING_LAMPS, MOST_LAMPS]
    else:
        numbers = [max(requested, _TELLING_LAMPS)]
    fits = _Fits(reduced, gather_evidence(reduced), numbers, build)
    lit = reduced.flash[reduced.usable].astype(np.float64)
    lit = lit[(lit > 0).all(axis=1)]
    if len(fits.evidence.pixels) < MIN_PIXELS or not len(lit):
        return sensor or srgb_stand_in()
    seen = _log_ratios(lit)
    given = sensor or typical_sensor()
    values = min(
        (given, balanced(given)),
        key=lambda one: np.linalg.norm(_log_ratios(_under(flash, one)) - seen),
    )
    if sensor is None:
        return min((srgb_stand_in(), values), key=fits.cost)
    return fits.much_likelier(values, [(srgb_stand_in(), _SRGB_LIKELIER)]) or values


def camera_warnings(frame: Frame, camera: Camera, named: bool, flattened: bool) -> list[RunWarning]:
    """Warn of a camera that is a guess, and of one that was named for what no sensor gives.

    frame: one of the files. camera: what was taken. named: whether the user named it. flattened:
    whether a contrast of the camera's was taken off the pair.
    """
    if frame.in_colour_space:
        one = no_sensors_values(frame, named, "the separation")
        return [replace(one, message=one.message + _WITHOUT_CONTRAST) if flattened else one]
    if not camera.approximate:
        return []
    taken = f"{camera.name} explains the pair best and was taken"
    by_exif = find_camera(None, frame)
    if frame.encoding == "linear" and not by_exif.approximate:
        message = (
            f"The photographs do not hold what the sensor of the {by_exif.name} gives, which they "
            f"name: {taken}. Send RAW files for exact work, or name the camera if they do."
        )
        return [RunWarning(Code.CAMERA_APPROXIMATE, message)]
    message = (
        "The camera's spectral sensitivities are not known and were approximated. Layers lose "
        "little by it, but colours and temperatures of lamps and white-balanced pictures may be "
        "far off: name a measured camera or send its table for exact work, or calibrate it."
    )
    if frame.encoding == "linear":
        message += f" The files do not say whose colours they hold: {taken}."
    return [RunWarning(Code.CAMERA_APPROXIMATE, message)]


def no_sensors_values(frame: Frame, named: bool, result: str) -> RunWarning:
    """Warn of files that are rendered or profiled, which hold no sensor's values.

    named: whether the user named a camera. result: what is approximate for it, in words.
    """
    otherwise = ""
    if frame.encoding == "srgb":
        code, what = Code.RENDERED_SRGB, "are rendered to sRGB, which bends colours and brightness"
        files, otherwise = "RAW or linear", _BETTER_RENDERED
    else:
        code, files = Code.CAMERA_APPROXIMATE, "RAW"
        what = "hold linear values in the colours that their profile says, not those of a sensor"
    message = f"The photographs {what}: {result} is approximate. Send {files} files for exact work."
    return RunWarning(code, message + otherwise + (_NOT_ITS_VALUES if named else ""))


def camera_doubts(
    reduced: ReducedPair,
    lamps: int,
    camera: Camera,
    frame: Frame,
    build: Callable[[Camera], Model],
) -> list[RunWarning]:
    """Warn of a named camera that explains a pair much worse than a typical sensor, or than sRGB.

    lamps: how many were found. frame: one of the files, of which RAW ones may say that the camera
    is theirs, and linear ones may hold sRGB. build: the model of a camera. Where one
    lamp was found, two are fitted, since a wrong camera may hide one; where three, two as well,
    since three that are asked for where there are two cost what chance has them cost. Nothing can
    be told of renderings and profiled files, and where shadows have no edges.
    """
    confirmed = frame.encoding == "raw" and find_camera(None, frame).name == camera.name
    if frame.in_colour_space or confirmed:
        return []
    alone = lamps < _TELLING_LAMPS
    others = [(typical_sensor(), _LIKELIER_UNDER_ONE if alone else _SENSOR_LIKELIER)]
    if frame.encoding == "linear":
        others.append((srgb_stand_in(), _LIKELIER_UNDER_ONE if alone else _SRGB_LIKELIER))
    numbers = sorted({_TELLING_LAMPS, max(lamps, _TELLING_LAMPS)})
    fits = _Fits(reduced, gather_evidence(reduced), numbers, build)
    better = fits.much_likelier(camera, others)
    if better is None:
        return []
    if better.in_srgb:
        message = (
            "The photographs do not look like sensor values of the camera named, but like linear "
            "sRGB: a converter may have written them. Send RAW files, or leave the camera out."
        )
    else:
        message = (
            f"A {better.name} explains the photographs much better than the camera named, so the "
            "layers may be wrong: check its name or table, and whether the files hold its own "
            "colours. If you do not know the camera, leave it out."
        )
    return [RunWarning(Code.CAMERA_DOUBTFUL, message)]


@dataclass(frozen=True)
class _Fits:
    """How well cameras explain a pair, with the likeliest of some numbers of lamps."""

    reduced: ReducedPair
    evidence: Evidence
    numbers: list[int]
    build: Callable[[Camera], Model]

    def cost(self, camera: Camera) -> float:
        model = self.build(camera)
        given = FitInput(self.reduced, self.evidence, model, nothing_known(model.flash_white))
        try:
            fits = [first_fit(given, number) for number in self.numbers]
        except UnusablePairError:  # the camera is so wrong that it makes no sense of any pixel
            return np.inf
        likeliest = min(fits, key=lambda fit: fit.cost)
        theta = model.prior.coordinates(likeliest.matrices)
        return likeliest.cost + _PRIOR_WEIGHT * model.prior.penalty(theta)[0]

    def much_likelier(
        self, camera: Camera, others: Sequence[tuple[Camera, float]]
    ) -> Camera | None:
        """Return which of the others is likeliest, if any is much likelier than the camera.

        others: with the cost by which each must be likelier.
        """
        if len(self.evidence.differences) < MANY:
            return None
        costs = {
            self.cost(other) + least: other
            for other, least in others
            if not np.array_equal(other.sensitivities, camera.sensitivities)
        }
        return costs[min(costs)] if costs and min(costs) < self.cost(camera) else None


def _under(flash: Floats64, camera: Camera) -> Floats64:
    """Colours (n, 3) of measured surfaces under the flash."""
    return np.asarray((reflectance_spectra() * flash) @ camera.sensitivities.T)


def _log_ratios(colours: Floats64) -> Floats64:
    """Medians (2,) of ln R/G and ln B/G over positive colours (n, 3)."""
    logs = np.log(colours)
    return np.asarray(np.median(logs[:, ::2] - logs[:, 1:2], axis=0))
