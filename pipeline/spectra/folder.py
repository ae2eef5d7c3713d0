"""The user's own folder of spectra, named by LIGHTLAYERS_SPECTRA."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pipeline.errors import OptionError, reason_of
from pipeline.spectra.names import key_of

_AMPAS_RANGE = re.compile(r"_\d+_\d+_\d+$")
"""The wavelength range at the end of a file's name in rawtoaces-data."""


_Read = TypeVar("_Read")


def names_are_known() -> bool:
    """Whether this host knows the names: no folder is set, or the one that is set is here."""
    root = _set_folder()
    return root is None or root.is_dir()


def folder_spectra() -> dict[str, list[Path]]:
    """Names and files of every CSV and JSON below the folder; empty when none is set.

    A name is the file's without its ending and range, underscores as spaces. One without letters
    and digits is left out, and files whose names have the same key (key_of) are listed together.
    Spectra are only ever looked up among these names, so a name cannot lead out of the folder.
    Raises OptionError where the setting names no folder.
    """
    root = _root()
    found: dict[str, tuple[str, list[Path]]] = {}
    for path in sorted(root.rglob("*")) if root else ():
        name = _AMPAS_RANGE.sub("", path.stem).replace("_", " ")
        if path.suffix.lower() in (".csv", ".json") and path.is_file() and key_of(name):
            found.setdefault(key_of(name), (name, []))[1].append(path)
    return dict(found.values())


def read_spectrum(paths: list[Path], read: Callable[[bytes], _Read]) -> _Read:
    """Read the file of the folder that has a name, of those that folder_spectra lists for it.

    It may be used unasked, so that an OptionError names it. Raises OptionError where it cannot be
    read, and where two files have that name.
    """
    path = paths[0]
    if len(paths) > 1:
        root = _root() or Path()
        one, other = (each.relative_to(root) for each in paths[:2])
        raise OptionError(
            f"The files {one} and {other} in the folder of LIGHTLAYERS_SPECTRA have the same name: "
            "rename one of them."
        )
    try:
        return read(path.read_bytes())
    except OSError as error:
        raise OptionError(
            f"The file {path.name} in the folder of LIGHTLAYERS_SPECTRA cannot be read: "
            f"{reason_of(error)}."
        ) from error
    except OptionError as error:
        raise OptionError(
            f"The file {path.name} in the folder of LIGHTLAYERS_SPECTRA cannot be used. {error}"
        ) from error


def _root() -> Path | None:
    root = _set_folder()
    if root is not None and not root.is_dir():
        raise OptionError("LIGHTLAYERS_SPECTRA names no folder: set it to one with spectra.")
    return root


def _set_folder() -> Path | None:
    setting = os.environ.get("LIGHTLAYERS_SPECTRA")
    return Path(setting) if setting else None
