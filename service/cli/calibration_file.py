"""Writes a calibration's file and the picture of its marks, and over no file of anybody else's."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import TypeAdapter, ValidationError

from pipeline.errors import InputError, OptionError, reason_of
from pipeline.options import DirectedLight, Sensitivities, Spectrum
from pipeline.spectra.tables import (
    parse_sensitivities,
    parse_spectrum,
    write_sensitivities,
    write_spectrum,
)
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from service import durable
from service.cli.files import read_file
from service.cli.keeping import marks_beside

if TYPE_CHECKING:
    from pipeline.taken_with import Kind

_LIGHTS = TypeAdapter(dict[str, list[DirectedLight]])
_ROUNDING = 2e-5  # of the length of a direction whose three parts have five digits


def check_target(kind: Kind, path: Path) -> None:
    """Refuse, before any work, a file that cannot be written or whose writing would lose another.

    An earlier calibration of this kind, with its marks, is to be replaced. Raises InputError.
    """
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
        lost = [file for file in (path, marks_beside(path)) if file.exists()]
    except OSError as error:
        raise _unwritable(path, error) from error
    if path in lost and _is_calibration(kind, read_file(path, "file")):
        return
    if lost:
        raise InputError(
            f"The file {lost[0]} would be lost, which is not known to be that of an earlier "
            "calibration of this kind: give another name, or move it first."
        )


def write(path: Path, content: bytes, marks: bytes) -> None:
    """Write what a calibration found, and the picture of its marks beside it. Raises InputError."""
    # the marks last: without the file beside them, the next calibration would not replace them
    for file, data in ((path, content), (marks_beside(path), marks)):
        try:
            durable.replace(file, data)
        except OSError as error:
            raise _unwritable(file, error) from error


def _is_calibration(kind: Kind, data: bytes) -> bool:
    """Whether it is of this kind, and of this program: tables of others are not."""
    table: Spectrum | Sensitivities
    try:
        if kind == "lamps":
            lights = _LIGHTS.validate_json(data)["lights"]
            told = all(light.taken_with for light in lights)
            return bool(lights) and (told or _is_older(lights, data))
        if kind == "flash":
            table = parse_spectrum(data)
            older = write_spectrum(table)
        else:
            table = parse_sensitivities(data)
            older = write_sensitivities(table)
    except (OptionError, ValidationError, KeyError):
        return False
    # before calibrations said what they were found with, they were written in this very form
    return bool(table.taken_with) or (
        data == older and table.wavelength_nm == WAVELENGTHS_NM.tolist()
    )


def _is_older(lights: Sequence[DirectedLight], data: bytes) -> bool:
    """Whether lamps stand in the very form of calibrations that did not say with what."""
    written = (json.dumps(json.loads(data), indent=1) + "\n").encode()
    lengths = np.linalg.norm([light.direction for light in lights], axis=1)
    return data == written and bool(np.allclose(lengths, 1.0, rtol=0, atol=_ROUNDING))


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"The file {path} cannot be written: {reason_of(error)}.")
