"""Cameras and flashes that nobody knows beforehand, and what calibrating finds of them."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import Floats64
from pipeline.calibration.calibrate import calibrate_files
from pipeline.calibration.options import CALIBRATION_OPTIONS, FILES
from pipeline.options import Sensitivities, Spectrum
from pipeline.progress import Progress
from pipeline.spectra.cameras import camera_from_table
from pipeline.spectra.lights import find_light
from pipeline.spectra.tables import parse_sensitivities, parse_spectrum
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from pipeline.taken_with import Kind
from tests.evaluation.spectra import Split, lamps, reflectances, sensitivities
from tests.targets import CORNERS, Shot

CAMERA = "Nikon D5100"
"""The one that is assumed."""

_CARD = {"x": 14.0, "y": 120.0, "radius": 12.0}  # grey wall beside the chart

Assumed = Mapping[str, Any]
"""Values of Options for camera and flash."""


def flashes(split: Split, count: int) -> list[Floats64]:
    """Measured white LEDs like those of phones, and as much xenon light off nearly white surfaces.

    count: even.
    """
    own = lamps(split)
    white = [i for i, name in enumerate(own.names) if "LED Phosphor" in name]
    cool = sorted(white, key=lambda i: -_blue_to_red(own.spectra[i]))[: count // 2]
    table = reflectances(split)
    pale = np.argsort(table.std(axis=1) / table.mean(axis=1) - 0.5 * table.min(axis=1))[
        : count // 2
    ]
    bounced = [find_light("xenon") * table[place] ** 2 for place in pale]
    mixed = [light for two in zip(own.spectra[cool], bounced, strict=True) for light in two]
    return [light / light.sum() for light in mixed]


def _blue_to_red(spectrum: Floats64) -> float:
    blue, red = (WAVELENGTHS_NM < 500), (WAVELENGTHS_NM >= 580)
    return float(spectrum[blue].sum() / spectrum[red].sum())


def cameras(split: Split, count: int) -> list[Floats64]:
    """Cameras as far from the assumed one as measured ones are (3, W): shifted, tinted, scaled."""
    random = np.random.default_rng(5 if split == "report" else 3)
    base = sensitivities(CAMERA)
    distance = np.square((WAVELENGTHS_NM[:, None] - WAVELENGTHS_NM) / 60.0)
    root = np.linalg.cholesky(np.exp(-0.5 * distance) + 1e-9 * np.eye(len(WAVELENGTHS_NM)))
    made = []
    for _ in range(count):
        channels = []
        for channel in base:
            shifted = np.interp(
                WAVELENGTHS_NM - 6.0 * random.standard_normal(), WAVELENGTHS_NM, channel
            )
            tint = np.exp(0.25 * root @ random.standard_normal(len(shifted)))
            channels.append(shifted * tint * np.exp(0.2 * random.standard_normal()))
        made.append(np.array(channels) / np.max(channels))
    return made


def measured_cameras(folder: Path) -> list[Floats64]:
    """Every camera of a folder of AMPAS JSON."""
    return [
        camera_from_table(path.stem, parse_sensitivities(path.read_bytes()), "file").sensitivities
        for path in sorted(folder.glob("*.json"))
        if "Nikon_D5100" not in path.stem
    ]


def ways(
    unknown: str, chart: Shot, s: Floats64, flash: Floats64
) -> dict[str, Callable[[], Assumed]]:
    """What may be assumed, by name. One of them is what is true."""
    camera, light = _sensitivities(s), _spectrum(flash)
    truth = {"camera": camera, "flash_spectrum": light}
    corners = {"chart": CORNERS}
    if unknown == "flash":
        known = {"camera": camera}
        return {
            "assumed": lambda: {**known, "flash_spectrum": "xenon"},
            "grey card": lambda: {**known, **calibrate("flash", chart, card=_CARD, **known)},
            "ColorChecker": lambda: {**known, **calibrate("flash", chart, **corners, **known)},
            "true": lambda: truth,
        }
    if unknown == "camera":
        told = {"flash_spectrum": light}
        return {
            "assumed": lambda: {**told, "camera": CAMERA},
            "ColorChecker": lambda: {**told, **calibrate("camera", chart, **corners, **told)},
            "ColorChecker, flash not told": lambda: {
                **told,
                **calibrate("camera", chart, **corners),
            },
            "true": lambda: truth,
        }

    def both() -> Assumed:
        found = calibrate("camera", chart, **corners)
        return {**found, **calibrate("flash", chart, **corners, **found)}

    return {
        "assumed": lambda: {"camera": CAMERA, "flash_spectrum": "xenon"},
        "ColorChecker": both,
        "true": lambda: truth,
    }


def calibrate(kind: Kind, shot: Shot, **marks: Any) -> Assumed:
    """What calibrating gives, as values of Options."""
    options = CALIBRATION_OPTIONS.validate_python(
        {"kind": kind, "encoding": "linear", "exposure_ratio": 1.0, **marks}
    )
    with tempfile.TemporaryDirectory() as name:
        calibrate_files(*shot.files, options, Path(name), Progress())
        data = (Path(name) / FILES[kind]).read_bytes()
    if kind == "camera":
        return {"camera": parse_sensitivities(data)}
    if kind == "flash":
        return {"flash_spectrum": parse_spectrum(data)}
    return {"light_directions": json.loads(data)["lights"]}


def _sensitivities(s: Floats64) -> Sensitivities:
    r, g, b = s.tolist()
    return Sensitivities(wavelength_nm=WAVELENGTHS_NM.tolist(), r=r, g=g, b=b)


def _spectrum(flash: Floats64) -> Spectrum:
    return Spectrum(wavelength_nm=WAVELENGTHS_NM.tolist(), power=flash.tolist())
