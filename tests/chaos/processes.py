"""The processes of a service under test, as /proc shows them: found by their data folder."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Process:
    """A living process; role: api, worker, fork server or child."""

    pid: int
    parent: int
    role: str


def of_folder(data: Path) -> list[Process]:
    """Find the living processes whose LIGHTLAYERS_DATA_DIR is this folder."""
    mark = f"LIGHTLAYERS_DATA_DIR={data}".encode()
    found: dict[int, tuple[int, str]] = {}
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if mark not in (path / "environ").read_bytes().split(b"\0"):
                continue
            state, parent = (path / "stat").read_text().rpartition(")")[2].split()[:2]
            if state not in "ZX":
                command = (path / "cmdline").read_bytes().replace(b"\0", b" ").decode()
                found[int(path.name)] = int(parent), command
    return [
        Process(pid, parent, _role(command, found.get(parent, (0, ""))[1]))
        for pid, (parent, command) in found.items()
    ]


def _role(command: str, of_parent: str) -> str:
    if "service.workers.child" in command:
        return "child" if "service.workers.child" in of_parent else "fork server"
    return "api" if "service.cli serve" in command else "worker"


def send(number: signal.Signals, processes: Iterable[Process]) -> None:
    """Send them all a signal; those that have ended meanwhile are left out."""
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, number)
