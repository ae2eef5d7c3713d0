"""The user's own folder of spectra, named by LIGHTLAYERS_SPECTRA."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pipeline.errors import OptionError

_AMPAS_RANGE = re.compile(r"_\d+_\d+_\d+$")
"""The wavelength range at the end of a file's name in rawtoaces-data."""


_Read = TypeVar("_Read")


def folder_spectra() -> dict[str, Path]:
    """Names and files of every CSV and JSON below the folder; empty when none is set.

    A name is the file's without its ending and range, underscores as spaces. Spectra are only
    ever looked up among these names, so a name cannot lead out of the folder.
    Raises OptionError where the setting names no folder.
    """
    setting = os.environ.get("LIGHTLAYERS_SPECTRA")
    if not setting:
        return {}
    root = Path(setting)
    if not root.is_dir():
        raise OptionError("LIGHTLAYERS_SPECTRA names no folder: set it to one with spectra.")
    return {
        _AMPAS_RANGE.sub("", path.stem).replace("_", " "): path
        for path in sorted(root.rglob("*"))
        if path.suffix.lower() in (".csv", ".json") and path.is_file()
    }


def read_spectrum(path: Path, read: Callable[[bytes], _Read]) -> _Read:
    """Read a file of the folder: it may be used unasked, so that an OptionError names it."""
    try:
        return read(path.read_bytes())
    except OSError as error:
        reason = (error.strerror or "it fails").lower()
        raise OptionError(
            f"The file {path.name} in the folder of LIGHTLAYERS_SPECTRA cannot be read: {reason}."
        ) from error
    except OptionError as error:
        raise OptionError(
            f"The file {path.name} in the folder of LIGHTLAYERS_SPECTRA cannot be used. {error}"
        ) from error
