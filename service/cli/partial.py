"""Folders for what is half written, of which those of killed runs go with the next run."""

from __future__ import annotations

import contextlib
import fcntl
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

_PREFIX = ".partial-"
_LOCK = "lock"


@contextlib.contextmanager
def partial_folder(target: Path) -> Iterator[Path]:
    """Make an empty folder below the folder `target` for as long as the block.

    Those that killed runs have left there are removed. Raises OSError.
    """
    _clear(target)
    with tempfile.TemporaryDirectory(dir=target, prefix=_PREFIX) as name, _locked(Path(name)):
        folder = Path(name) / "results"
        folder.mkdir()
        yield folder


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold a lock in a folder, which the kernel drops with the process."""
    with tempfile.NamedTemporaryFile(dir=folder, delete=False) as lock:
        with contextlib.suppress(OSError):  # a file system without locks: it is never cleared
            fcntl.flock(lock, fcntl.LOCK_EX)
            Path(lock.name).rename(folder / _LOCK)  # only now, so that nobody finds it free
        yield


def _clear(target: Path) -> None:
    for path in target.glob(f"{_PREFIX}*/{_LOCK}"):
        # whose run lives, or which is another user's, stays
        with contextlib.suppress(OSError), path.open("r+b") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(path.parent)
