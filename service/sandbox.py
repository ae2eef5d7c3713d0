"""Runs one task of a job in a process of its own, so that what breaks it breaks only this job."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any, Literal

import cv2

from service.errors import CrashError, MemoryLimitError, TimeLimitError
from service.forkserver import ForkServer
from service.processes import OUT_OF_MEMORY

_COMMAND = (sys.executable, "-m", "service.child")
_THREADS = ("OPENCV_FOR_THREADS_NUM", "OMP_NUM_THREADS")
"""What the libraries of a task with threads of their own read: OpenCV, and LibRaw's OpenMP."""

_LOOK_SECONDS = 0.2
_END_SECONDS = 5.0  # what a process whose work is done may take to end


class StoppedError(Exception):
    """must_stop() said so; the process is dead."""


class TaskError(Exception):
    """The process reported a problem."""

    def __init__(self, problem: dict[str, Any]) -> None:
        super().__init__(problem["detail"])
        self.problem = problem


@dataclass(frozen=True)
class Task:
    """What a process is to do.

    kind "check": the headers of directory/no_flash and directory/flash.
    kind "separate": directory/no_flash and directory/flash, with options → directory/results.
    kind "calibrate": the same, with the options of a calibration.
    kind "mix": directory/layers.exr and directory/manifest.json, with the options of a mix →
        directory/results.
    kind "capture": the camera that capture names → directory/no_flash and directory/flash.
    """

    kind: Literal["check", "separate", "calibrate", "mix", "capture"]
    job: str
    trace_id: str
    directory: str
    memory_bytes: int
    cpu_seconds: int
    options: dict[str, Any]
    capture: dict[str, Any] | None


def fork_server(at_once: int) -> ForkServer:
    """Make the server of the processes that tasks run in, for so many tasks at once.

    They share the processors: each has as many threads as there are processors for it. Variables
    that the operator has set stay.
    """
    threads = str(max(cv2.getNumberOfCPUs() // at_once, 1))
    shares = {name: os.environ.get(name, threads) for name in _THREADS}
    return ForkServer(_COMMAND, shares)


def run(
    task: Task,
    seconds: float,
    report: Callable[[str, float], None],
    must_stop: Callable[[], bool],
    server: ForkServer,
) -> None:
    """Run a task to its end, for at most `seconds`; must_stop is asked several times a second.

    Raises TaskError, StoppedError, CrashError, MemoryLimitError, TimeLimitError or
    ChildProcessError.
    """
    deadline = time.monotonic() + seconds
    problem: dict[str, Any] | None = None
    with contextlib.closing(server.fork()) as process:
        with contextlib.suppress(BrokenPipeError), process.stdin:
            process.stdin.write(json.dumps(asdict(task)).encode())
        for message in _messages(process.stdout, deadline, must_stop):
            if "problem" in message:
                problem = message["problem"]
            else:
                report(message["stage"], message["fraction"])
        try:
            code = process.wait(max(deadline - time.monotonic(), _END_SECONDS))
        except TimeoutError as error:
            raise TimeLimitError(_TOO_LONG) from error
    if problem is not None:
        raise TaskError(problem)
    _raise_for_exit(code)


def _messages(
    stdout: IO[bytes], deadline: float, must_stop: Callable[[], bool]
) -> Iterator[dict[str, Any]]:
    rest = b""
    with selectors.DefaultSelector() as selector:
        selector.register(stdout, selectors.EVENT_READ)
        while True:
            ready = selector.select(_LOOK_SECONDS)
            if must_stop():
                raise StoppedError
            if time.monotonic() > deadline:
                raise TimeLimitError(_TOO_LONG)
            if not ready:
                continue
            chunk = os.read(stdout.fileno(), 65536)
            if not chunk:
                return
            *lines, rest = (rest + chunk).split(b"\n")
            yield from (json.loads(line) for line in lines)


_TOO_LONG = "The separation took longer than a job may take; send smaller photographs."


def _raise_for_exit(code: int) -> None:
    if code == 0:
        return
    if code == -signal.SIGXCPU:
        raise TimeLimitError(_TOO_LONG)
    if code == OUT_OF_MEMORY:
        raise MemoryLimitError(
            "The photographs need more memory than a job may have; send smaller ones."
        )
    if code == -signal.SIGKILL:
        raise MemoryLimitError(
            "The system killed the program, most likely for want of memory; "
            "send smaller photographs."
        )
    how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    raise CrashError(
        f"The program crashed on these photographs ({how}); "
        "if both open elsewhere, report it with this job's trace_id."
    )


def results_of(directory: Path) -> list[Path]:
    """List the files that a "separate", "calibrate" or "mix" task wrote, by name."""
    return sorted(path for path in (directory / "results").iterdir() if path.is_file())
