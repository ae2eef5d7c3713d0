"""What a process or a call costs."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

_LAUNCHER = Path(__file__).with_name("launcher.py")


@dataclass(frozen=True)
class Usage:
    """cpu_s, wall_s: seconds. peak_mb: largest resident size, in MiB."""

    cpu_s: float
    wall_s: float
    peak_mb: float


def run(command: Sequence[str]) -> Usage:
    """Run a command to its end. Raises CalledProcessError with what it said."""
    launched = subprocess.run(
        [sys.executable, "-S", str(_LAUNCHER)],
        input=json.dumps([*map(str, command)]),
        capture_output=True,
        text=True,
        check=True,
    )
    one = json.loads(launched.stdout)
    if one["code"]:
        raise subprocess.CalledProcessError(one["code"], command, stderr=one["said"])
    return Usage(one["cpu_s"], one["wall_s"], one["peak_mb"])


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
