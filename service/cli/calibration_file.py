"""The file that a calibration writes and the picture of its marks, which cost nobody a file."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import TypeAdapter, ValidationError

from pipeline.errors import InputError, OptionError, reason_of
from pipeline.options import DirectedLight, Sensitivities, Spectrum
from pipeline.spectra.tables import parse_sensitivities, parse_spectrum
from service import durable
from service.cli.files import read_file
from service.cli.keeping import marks_beside

if TYPE_CHECKING:
    from pipeline.calibration.options import Kind

_LIGHTS = TypeAdapter(dict[str, list[DirectedLight]])


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
    """Whether it is of this kind, and says with what it was found: tables of others do not."""
    found: Sequence[DirectedLight | Spectrum | Sensitivities]
    try:
        if kind == "lamps":
            found = _LIGHTS.validate_json(data)["lights"]
        else:
            found = [parse_spectrum(data) if kind == "flash" else parse_sensitivities(data)]
    except (OptionError, ValidationError, KeyError):
        return False
    return bool(found) and all(one.taken_with for one in found)


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"The file {path} cannot be written: {reason_of(error)}.")
