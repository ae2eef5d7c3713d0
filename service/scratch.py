"""Folders for photographs while a process works on them, and none left behind by killed ones."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def folder(data_dir: Path) -> Iterator[Path]:
    """Make a folder that lives as long as the block, or until clear() when the process is killed.

    Raises OSError where data_dir cannot be written.
    """
    parent = data_dir / "work"
    parent.mkdir(parents=True, exist_ok=True)
    with _locked(parent):
        path = Path(tempfile.mkdtemp(dir=parent))
        owned = os.open(path, os.O_RDONLY)
        fcntl.flock(owned, fcntl.LOCK_EX)
    try:
        yield path
    finally:
        shutil.rmtree(path)
        os.close(owned)


def clear(data_dir: Path) -> None:
    """Remove the folders whose process is dead; the kernel has dropped its locks on them."""
    parent = data_dir / "work"
    if not parent.exists():
        return
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


@contextmanager
def _locked(parent: Path) -> Iterator[None]:
    """Keep clear() from meeting a folder between its making and its lock."""
    descriptor = os.open(parent, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
