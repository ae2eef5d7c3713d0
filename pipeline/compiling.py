"""How modules with loops have them compiled, and where their code is kept.

Numba keeps code, and reads what is kept, only where it may write; where that is nowhere, modules
with loops cannot even be imported. A process that may only read what was compiled, like one in an
image with another user, gets a folder of its own with links to it.

Numba sees a change of the file that a function is in, and none of the files whose functions and
constants are compiled into it. So each version of this package has a folder that is named for it.
"""

from __future__ import annotations

import atexit
import importlib
import os
import shutil
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
from numba import njit
from numba.core.registry import cpu_target

from pipeline.code_digest import digest

_config: Any = numba.config  # which has what the variables NUMBA_… said

_PREFIX = "code-"
_OTHERS = 2
"""Versions whose code is left when a new one comes: their processes may go on for a while."""


@dataclass(frozen=True)
class Cache:
    """Where the code of this package's modules is, in a folder for each folder of them."""

    folder: Path
    unwritable: Path | None = None
    """Where it should be, if it cannot be written; `folder` then ends with this process."""

    def is_filled(self) -> bool:
        """Whether code for this processor is there."""
        marks = [part.encode() for part in cpu_target.target_context.codegen().magic_tuple()]
        indices = (path.read_bytes() for path in self.folder.glob("*/*.nbi"))
        return any(all(mark in index for mark in marks) for index in indices)


def settle() -> Cache:
    """Find the folder that code is kept in, or make one for the life of this process."""
    home = _home()
    wanted = home / f"{_PREFIX}{digest(Path(__file__).parent)}"
    is_new = not os.access(wanted, os.F_OK)
    _config.CACHE_DIR = str(wanted)
    try:
        # A user's own folder, which Numba takes next, would have nothing of what is compiled.
        if _folder().is_relative_to(wanted):
            if is_new:
                _forget_older(wanted)
            return Cache(wanted)
    except RuntimeError:
        pass
    own = Path(tempfile.mkdtemp(prefix="lightlayers-compiled-"))
    atexit.register(_remove, own, os.getpid())
    for path in wanted.glob("*/*.nb[ic]"):
        (own / path.parent.name).mkdir(exist_ok=True)
        (own / path.parent.name / path.name).symlink_to(path)  # Numba replaces files, links too
    _config.CACHE_DIR = str(own)
    return Cache(own, home)


def _home() -> Path:
    """Where the folders of versions are: as NUMBA_CACHE_DIR says, or where Numba would keep it."""
    if _config.CACHE_DIR:
        return Path(_config.CACHE_DIR).absolute()
    try:
        return _folder()
    except RuntimeError:
        return Path(__file__).with_name("__pycache__")


def _forget_older(wanted: Path) -> None:
    """Remove what other versions compiled, but for the newest. One that runs compiles anew."""
    with suppress(OSError):  # another process removes them, too
        others = [path for path in wanted.parent.glob(f"{_PREFIX}*") if path != wanted]
        for path in sorted(others, key=lambda path: path.stat().st_mtime)[:-_OTHERS]:
            shutil.rmtree(path, ignore_errors=True)


def _folder() -> Path:
    """Where Numba keeps code of modules beside this one. Raises RuntimeError for nowhere."""
    return Path(str(njit(cache=True)(_folder).stats.cache_path))


def _remove(folder: Path, owner: int) -> None:
    if os.getpid() == owner:  # and not a fork of it
        shutil.rmtree(folder, ignore_errors=True)


def _load_without_blas() -> None:
    """Load Numba's arrays, which look for SciPy's BLAS, though no loop here multiplies matrices.

    Its import would take as long as all else that the first function waits for.
    """
    if (blas := "scipy.linalg") not in sys.modules:
        sys.modules[blas] = None  # type: ignore[assignment]  # so that its import fails
        try:
            importlib.import_module("numba.np.arraymath")
        finally:
            del sys.modules[blas]


def prepare() -> None:
    """Load of Numba what the first compiled function that a process calls would wait for."""
    importlib.import_module("numpy.ma")  # whose arrays Numba tells from others
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()


CACHE = settle()
_load_without_blas()

exact = njit(cache=True, nogil=True, error_model="numpy")
"""For loops whose operations are to be those that are written; division by 0 raises nothing.

These and the next let other threads go on meanwhile."""

spliced = njit(cache=True, error_model="numpy", inline="always")
"""For what loops call, as if written there: under the loop's own rules, whichever they are."""

compiled = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
"""For loops over pixels: as exact, but multiplications and additions in one."""

inlined = njit(error_model="numpy", fastmath={"contract"}, forceinline=True)
"""The same for what these loops call, as part of them, so that they become vector code."""

summing = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
"""For sums, in any order, since in the order written no two can be added at once."""
