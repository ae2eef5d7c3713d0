"""Whether this machine has what processes of the service take: a folder, room, memory, code."""

from __future__ import annotations

import os
import resource
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from pipeline import compiling
from pipeline.errors import counted, reason_of
from service.doctor.finding import Finding
from service.settings import Settings

_OPEN_FILES = 1024  # each connection and photograph takes one
_MEMORY_LIMITS = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)
"""Of the container, by control groups of version 2 and 1; "max" or a huge number for none."""


def look_at_folder(settings: Settings) -> Iterator[Finding]:
    """Look whether data_dir can be written, and by its user alone."""
    folder = settings.data_dir
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        yield Finding(
            "wrong",
            "data_dir",
            f"{folder} cannot be written ({reason_of(error)}): give it to the user that runs the "
            "service, or set LIGHTLAYERS_DATA_DIR.",
        )
        return
    if folder.stat().st_mode & 0o077:
        yield Finding(
            "note",
            "data_dir",
            f"other users of this machine may look into {folder}: chmod 700 keeps photographs "
            "private.",
        )
    else:
        yield Finding("ok", "data_dir", f"{folder} can be written, by its user alone.")


def look_at_disk(settings: Settings) -> Iterator[Finding]:
    """Look at the room where requests are received and jobs run."""
    folders = (settings.data_dir, *settings.data_dir.parents)
    folder = next(path for path in folders if os.access(path, os.F_OK))
    free = shutil.disk_usage(folder).free
    said = f"{free / 2**30:.1f} GiB are free at {folder}"
    if free < settings.upload_bytes:
        less = "less than LIGHTLAYERS_UPLOAD_BYTES: large requests and their jobs fail; make room."
        yield Finding("note", "disk", f"{said}, {less}")
    else:
        yield Finding("ok", "disk", f"{said}.")


def look_at_memory(settings: Settings) -> Iterator[Finding]:
    """Look whether the jobs at a time find the memory that they may take."""
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    needed = settings.job_memory_bytes
    if most != resource.RLIM_INFINITY and most < needed:
        yield Finding(
            "wrong",
            "memory",
            f"ulimit -v allows {most / 2**30:.1f} GiB, less than LIGHTLAYERS_JOB_MEMORY_BYTES: "
            "raise the one or lower the other.",
        )
        return
    there = _memory_bytes()
    wanted = needed * settings.worker_concurrency
    at_once = counted(settings.worker_concurrency, "job", "jobs")
    said = f"{there / 2**30:.1f} GiB for {at_once} at a time"
    if there < wanted:
        yield Finding(
            "note",
            "memory",
            f"{said}, which may take {wanted / 2**30:.1f} GiB of addresses: large photographs may "
            "be killed by the system; lower LIGHTLAYERS_JOB_MEMORY_BYTES to have them told.",
        )
    else:
        yield Finding("ok", "memory", f"{said}.")


def _memory_bytes() -> int:
    """Memory of this machine, or of the container that we are in."""
    there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    texts = [limit.read_text().strip() for limit in _MEMORY_LIMITS if limit.exists()]
    return min([there, *(int(text) for text in texts if text != "max")])


def look_at_open_files(settings: Settings) -> Iterator[Finding]:
    """Look at how many files processes may open."""
    soft, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != resource.RLIM_INFINITY and soft < _OPEN_FILES:
        yield Finding(
            "wrong", "ulimits", f"ulimit -n is {soft}, too few files: make it {_OPEN_FILES}."
        )
    elif most != resource.RLIM_INFINITY and most < settings.job_open_files:
        yield Finding(
            "wrong",
            "ulimits",
            f"ulimit -Hn allows {most} files, fewer than LIGHTLAYERS_JOB_OPEN_FILES: raise the one "
            "or lower the other.",
        )
    else:
        yield Finding("ok", "ulimits", f"ulimit -n is {soft}.")


def look_at_kernels(_settings: Settings) -> Iterator[Finding]:
    """Look whether what jobs run is compiled."""
    cache, filled = compiling.CACHE, compiling.CACHE.is_filled()
    command = f"{shlex.quote(sys.executable)} -m service.compile"  # which has it, as no other may
    if filled and cache.unwritable:
        sentence = f"they are compiled; {cache.unwritable} cannot be written, so no more are kept."
    elif filled:
        sentence = f"they are compiled for this processor, in {cache.folder}."
    elif cache.unwritable:
        sentence = (
            f"none are compiled for this processor and {cache.unwritable} cannot be written, so "
            "that each process compiles them anew: give it to the user that runs the service, or "
            "set NUMBA_CACHE_DIR."
        )
    else:
        sentence = f"the first jobs will compile them for this processor: run `{command}`."
    missing: Literal["note", "wrong"] = "wrong" if cache.unwritable else "note"
    yield Finding("ok" if filled else missing, "kernels", sentence)
