"""What a process or a call costs."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

_MIB = 1024.0


@dataclass(frozen=True)
class Usage:
    """cpu_s, wall_s: seconds. peak_mb: largest resident size, in MiB."""

    cpu_s: float
    wall_s: float
    peak_mb: float


def run(command: Sequence[str]) -> Usage:
    """Run a command to its end. Raises CalledProcessError with what it said."""
    return together([command])


def together(commands: Sequence[Sequence[str]]) -> Usage:
    """Run commands at once: CPU of all, wall time until the last ends, peak of the largest."""
    start = time.monotonic()
    pipe = subprocess.PIPE
    started = [
        subprocess.Popen(one, stdout=subprocess.DEVNULL, stderr=pipe, text=True) for one in commands
    ]
    cpu, peak = 0.0, 0.0
    for command, process in zip(commands, started, strict=True):
        said = process.stderr.read() if process.stderr else ""
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.stderr:
            process.stderr.close()
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, command, stderr=said)
        cpu += used.ru_utime + used.ru_stime
        peak = max(peak, used.ru_maxrss / _MIB)
    return Usage(cpu, time.monotonic() - start, peak)


def python(*arguments: str) -> list[str]:
    """Command line of this Python."""
    return [sys.executable, *arguments]


def medians(usages: Sequence[Usage]) -> Usage:
    """The median of each figure."""
    return Usage(*(median(getattr(u, f) for u in usages) for f in ("cpu_s", "wall_s", "peak_mb")))


def cpu_of(calls: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median CPU seconds of calls, made by turns so that a noisy machine treats all alike."""
    for call in calls.values():
        call()  # compiles, and touches memory
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.process_time()
            call()
            seconds[name].append(time.process_time() - start)
    return {name: median(found) for name, found in seconds.items()}
