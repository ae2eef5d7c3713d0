"""Folders for photographs while a process works on them, and none left behind by killed ones."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from pipeline.errors import reason_of
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

    Raises StartError where data_dir, or what lies in it, is not this user's to write.
    """
    with usable(data_dir):
        data_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
        parent = data_dir / "work"
        parent.mkdir(exist_ok=True)
        if not os.access(parent, os.W_OK | os.X_OK):  # else the first job would find it out
            raise PermissionError(errno.EACCES, "it cannot be written")
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
def usable(data_dir: Path) -> Iterator[None]:
    """Raise StartError where the block cannot use data_dir."""
    try:
        yield
    except OSError as error:
        raise StartError(
            f"The folder {data_dir} cannot be used ({reason_of(error)}): give it, with all that is "
            "in it, to the user that runs the service, or check LIGHTLAYERS_DATA_DIR."
        ) from error


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; that of their parent keeps clear() from folders without one."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
