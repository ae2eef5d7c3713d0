"""Folders for photographs while a process works on them, and none left behind by killed ones."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from service.errors import StartError


@contextlib.contextmanager
def folder(data_dir: Path) -> Iterator[Path]:
    """Make a folder that lives as long as the block, or until clear() when the process is killed.

    Raises OSError where data_dir cannot be written.
    """
    parent = data_dir / "work"
    parent.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        with _locked(parent):
            path = Path(tempfile.mkdtemp(dir=parent))
            try:
                stack.enter_context(_locked(path))
            except OSError:
                path.rmdir()
                raise
        stack.callback(shutil.rmtree, path)  # before its lock goes, which does so in any case
        yield path


def clear(data_dir: Path) -> None:
    """Remove the folders whose process is dead; the kernel has dropped its locks on them.

    Raises StartError where data_dir may not be entered.
    """
    parent = data_dir / "work"
    try:
        if not parent.exists():
            return
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise StartError(
            f"The folder {data_dir} cannot be opened: check LIGHTLAYERS_DATA_DIR ({reason})."
        ) from error
    with _locked(parent):
        for path in parent.iterdir():
            try:
                descriptor = os.open(path, os.O_RDONLY)
            except FileNotFoundError:  # whoever had it was done with it just now
                continue
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(path)
            except BlockingIOError:
                continue
            finally:
                os.close(descriptor)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; that of their parent keeps clear() from folders without one."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
