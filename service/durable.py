"""Files that outlast a power cut once they are said to be there."""

from __future__ import annotations

import errno
import os
from pathlib import Path

FULL = (errno.ENOSPC, errno.EDQUOT)
"""What the system says of a disk that takes no more."""


def flush(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write(path: Path, data: bytes) -> None:
    """Write a new file, on the disk when this is done; its folder is still to be flushed."""
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def replace(path: Path, data: bytes) -> None:
    """Write a file in place of what is there: the old one or the new one, never half of it.

    Raises OSError.
    """
    new = path.with_name(f".{path.name[-60:]}.new")  # no longer than a system's names may be
    new.unlink(missing_ok=True)
    try:
        write(new, data)
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)  # half of it, on a disk that is full
    flush(path.parent)
