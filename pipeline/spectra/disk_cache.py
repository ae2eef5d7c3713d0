"""Tables that take colour-science long to make, cached in files.

It takes half a second to import, and its tables another tenth: more than most jobs
spend on finding lamps. They lie in NUMBA_CACHE_DIR or beside this module, where versions of
this package share them: each file has a stamp.
"""

from __future__ import annotations

import functools
import io
import os
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.code_digest import digest

_Given = ParamSpec("_Given")
_Table = TypeVar("_Table", bound=NDArray[Any])


def cached_on_disk(make: Callable[_Given, _Table]) -> Callable[_Given, _Table]:
    """Decorate a function that makes a table by colour-science: its file gives it once made.

    What the function returns must follow from its arguments, the modules beside this one and the
    library's version alone; arrays are read-only. Where no file can be written it is made each
    time.
    """

    @functools.wraps(make)
    def table(*args: _Given.args, **kwargs: _Given.kwargs) -> _Table:
        given = "-".join(map(str, (*args, *kwargs.values())))
        path = _folder() / f"{make.__name__}{given and '-' + given}.npz"
        values: _Table | None = _read(path, _stamp())
        if values is None:
            values = make(*args, **kwargs)
            _write(path, _stamp(), values)
        values.setflags(write=False)
        return values

    return table


def _folder() -> Path:
    given = os.environ.get("NUMBA_CACHE_DIR")
    return Path(given) if given else Path(__file__).with_name("__pycache__")


@functools.cache
def _stamp() -> str:
    library = "colour-science"
    return f"{library} {version(library)}, modules {digest(Path(__file__).parent)}"


def _read(path: Path, stamp: str) -> Any:
    try:
        file = np.load(io.BytesIO(path.read_bytes()), allow_pickle=False)
        return file["values"] if str(file["stamp"]) == stamp else None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _write(path: Path, stamp: str, values: NDArray[Any]) -> None:
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
            try:
                np.savez(file, stamp=np.array(stamp), values=values)
                file.close()
                Path(file.name).chmod(0o644)  # like Numba's, for whoever runs what was installed
                Path(file.name).replace(path)
            except BaseException:
                Path(file.name).unlink(missing_ok=True)
                raise
