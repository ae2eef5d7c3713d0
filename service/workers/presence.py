"""Which workers of this machine have died, told by locks that the kernel drops with a process.

What they had is taken over at once then, without waiting for the silence after which a worker of
another machine is taken for dead.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Generator
from pathlib import Path

from service.workers import scratch

_UNNAMED = "."  # files begin with it until they are locked


def enter(data_dir: Path, worker: str) -> None:
    """Say that this process is a worker, for as long as it lives.

    Raises StartError where data_dir cannot be written.
    """
    folder = _folder(data_dir)
    with scratch.usable(data_dir):
        folder.mkdir(parents=True, exist_ok=True)
        # Never closed: the lock goes with the process.
        descriptor, path = tempfile.mkstemp(dir=folder, prefix=_UNNAMED)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        Path(path).rename(folder / worker)


def leave(data_dir: Path, worker: str) -> None:
    """Say that a worker ends."""
    (_folder(data_dir) / worker).unlink(missing_ok=True)


def dead(data_dir: Path) -> Generator[str]:
    """Workers whose process has died; each is forgotten when the next one is asked for."""
    for path in sorted(_folder(data_dir).glob("[!.]*")):
        try:
            descriptor = os.open(path, os.O_RDONLY)
        except FileNotFoundError:  # another worker was quicker
            continue
        except PermissionError:  # of another user, whose workers or whose silence will tell
            continue
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            continue
        finally:
            os.close(descriptor)
        yield path.name
        path.unlink(missing_ok=True)


def _folder(data_dir: Path) -> Path:
    return data_dir / "workers"
