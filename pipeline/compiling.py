"""njit, for every module with loops to compile, and where their code is kept.

Numba keeps code, and reads what is kept, only where it may write; where that is nowhere, modules
with loops cannot even be imported. A process that may only read what was compiled, like one in an
image with another user, gets a folder of its own with links to it.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
from numba import njit
from numba.core.registry import cpu_target

__all__ = ["CACHE", "Cache", "njit", "settle"]

_config: Any = numba.config  # which has what the variables NUMBA_… said


@dataclass(frozen=True)
class Cache:
    """Where the code of this package's modules is."""

    folder: Path
    unwritable: Path | None = None
    """Where it should be, if it cannot be written; `folder` then ends with this process."""

    def is_filled(self) -> bool:
        """Whether code for this processor is there."""
        marks = [part.encode() for part in cpu_target.target_context.codegen().magic_tuple()]
        indices = (path.read_bytes() for path in self.folder.glob("*.nbi"))
        return any(all(mark in index for mark in marks) for index in indices)


def settle() -> Cache:
    """Find the folder that code is kept in, or make one for the life of this process."""
    given = _config.CACHE_DIR
    wanted = Path(given or Path(__file__).with_name("__pycache__"))
    try:
        found = _folder()
        # A user's own folder, which Numba takes next, would have nothing of what is compiled.
        if not given or found.is_relative_to(wanted):
            return Cache(found)
    except RuntimeError:
        pass
    own = Path(tempfile.mkdtemp(prefix="lightlayers-compiled-"))
    atexit.register(_remove, own, os.getpid())
    for path in wanted.absolute().glob("*/*.nb[ic]"):
        (own / path.parent.name).mkdir(exist_ok=True)
        (own / path.parent.name / path.name).symlink_to(path)  # Numba replaces files, links too
    _config.CACHE_DIR = str(own)
    return Cache(_folder(), wanted)


def _folder() -> Path:
    """Where Numba keeps code of modules beside this one. Raises RuntimeError for nowhere."""
    return Path(str(njit(cache=True)(_folder).stats.cache_path))


def _remove(folder: Path, owner: int) -> None:
    if os.getpid() == owner:  # and not a fork of it
        shutil.rmtree(folder, ignore_errors=True)


CACHE = settle()
