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
from pathlib import Path
from typing import IO, Any

import cv2

from service.errors import (
    CrashError,
    FileLimitError,
    KilledError,
    MemoryLimitError,
    NoProcessError,
    OutputLimitError,
    StorageFullError,
    TimeLimitError,
)
from service.workers import shortage
from service.workers.forkserver import ForkServer
from service.workers.processes import DISK_FULL, NO_PROCESS, OUT_OF_FILES, OUT_OF_MEMORY
from service.workers.tasks import PAIRS, Task

_COMMAND = (sys.executable, "-m", "service.workers.child")
_THREADS = ("OPENCV_FOR_THREADS_NUM", "OMP_NUM_THREADS")
"""What the libraries of a task with threads of their own read: OpenCV, and LibRaw's OpenMP."""

_LOOK_SECONDS = 0.2  # between two looks whether the task is to stop
_END_SECONDS = 5.0  # what a process whose work is done may take to end


Ask = Callable[[dict[str, Any], Callable[[], bool]], bool]
"""Answers a question of a process; told how to learn that it is dead and wants no answer."""


class StoppedError(Exception):
    """must_stop() said so; the process is dead."""


class TaskError(Exception):
    """The process reported a problem."""

    def __init__(self, problem: dict[str, Any]) -> None:
        super().__init__(problem["detail"])
        self.problem = problem


def fork_server(at_once: int, pairs: bool) -> ForkServer:
    """Make the server of the processes that tasks run in, for so many tasks at once.

    pairs: whether tasks separate, calibrate or mix: what that takes is imported first then.
    They share the processors: each has as many threads as there are processors for it. Variables
    that the operator has set stay.
    """
    threads = str(max(cv2.getNumberOfCPUs() // at_once, 1))
    shares = {name: os.environ.get(name, threads) for name in _THREADS}
    return ForkServer((*_COMMAND, PAIRS) if pairs else _COMMAND, shares)


def run(
    task: Task,
    report: Callable[[str, float], None],
    must_stop: Callable[[], bool],
    server: ForkServer,
    ask: Ask | None = None,
) -> Any:
    """Run a task to its end, or to its limits; must_stop is asked several times a second.

    Gives what it answers with. ask: called with its questions; the time it takes does not count,
    and it may raise StoppedError. Raises TaskError, StoppedError, CrashError, MemoryLimitError,
    KilledError, TimeLimitError, FileLimitError, OutputLimitError, ChildProcessError, or, when the
    disk is full, StorageFullError; NoProcessError where the task has not begun.
    """
    deadline = time.monotonic() + task.limits.seconds
    captures = task.kind == "capture"
    too_long = _CAPTURE_TOO_LONG if captures else _TOO_LONG

    def is_over() -> bool:
        _check_output(task)
        return must_stop()

    def seconds_left() -> float:
        return deadline - time.monotonic()

    answer: Any = None
    problem: dict[str, Any] | None = None
    with contextlib.closing(server.fork()) as process:
        _write(process.stdin, task.to_json())
        if ask is None:
            _close(process.stdin)
        for message in _messages(process.stdout, seconds_left, is_over, too_long):
            if "problem" in message:
                problem = message["problem"]
            elif "answer" in message:
                answer = message["answer"]
            elif "question" in message and ask:
                asked = time.monotonic()
                _write(process.stdin, json.dumps(ask(message["question"], process.has_ended)))
                deadline += time.monotonic() - asked
            else:
                report(message["stage"], message["fraction"])
        try:
            code = process.wait(max(seconds_left(), _END_SECONDS))
        except TimeoutError as error:
            raise TimeLimitError(too_long) from error
    if problem is not None:
        raise TaskError(problem)
    _raise_for_exit(code, too_long, captures)
    _check_output(task)
    return answer


def _write(stdin: IO[bytes], line: str) -> None:
    with contextlib.suppress(BrokenPipeError):  # its exit code says why it is dead
        stdin.write(line.encode() + b"\n")
        stdin.flush()


def _close(stdin: IO[bytes]) -> None:
    with contextlib.suppress(BrokenPipeError):
        stdin.close()


def _check_output(task: Task) -> None:
    """Raise OutputLimitError once all that a task has written is more than it may write."""
    # The kernel limits each file alone.
    written = 0
    for path in Path(task.directory).rglob("*"):
        with contextlib.suppress(FileNotFoundError):  # it may just have been renamed
            written += path.stat().st_size if path.is_file() else 0
    if written > task.limits.output_bytes:
        raise OutputLimitError(_TOO_MUCH)


def _messages(
    stdout: IO[bytes],
    seconds_left: Callable[[], float],
    must_stop: Callable[[], bool],
    too_long: str,
) -> Iterator[dict[str, Any]]:
    rest = b""
    with selectors.DefaultSelector() as selector:
        selector.register(stdout, selectors.EVENT_READ)
        while True:
            ready = selector.select(_LOOK_SECONDS)
            if must_stop():
                raise StoppedError
            if seconds_left() < 0:
                raise TimeLimitError(too_long)
            if not ready:
                continue
            chunk = os.read(stdout.fileno(), 65536)
            if not chunk:
                return
            *lines, rest = (rest + chunk).split(b"\n")
            yield from (json.loads(line) for line in lines)


_TOO_MUCH = (
    "The results are larger than a job's may be; ask for fewer, or send smaller photographs."
)
DISK_IS_FULL = "The disk on which jobs run is full; send this one again later."
_TOO_LONG = "The job took longer than it may take; send smaller photographs."
_CAPTURE_TOO_LONG = (
    "The capture took longer than a job may take; check the camera's connection and take the pair "
    "again."
)


def _raise_for_exit(code: int, too_long: str, captures: bool) -> None:
    if code == 0:
        return
    if code == NO_PROCESS:
        raise NoProcessError
    if code == -signal.SIGXCPU:
        raise TimeLimitError(too_long)
    if code == OUT_OF_MEMORY:
        raise MemoryLimitError(shortage.TOLD)
    if code == -signal.SIGXFSZ:
        raise OutputLimitError(_TOO_MUCH)
    if code == OUT_OF_FILES:
        raise FileLimitError("The job needs more open files than it may have.")
    if code == DISK_FULL:
        raise StorageFullError(DISK_IS_FULL)
    if code == -signal.SIGKILL:
        raise KilledError(
            "The system killed the program, most likely for want of memory; "
            + ("take the pair again." if captures else "send smaller photographs.")
        )
    how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    if captures:
        raise CrashError(
            f"The program crashed over the camera ({how}); switch that off and on and take the "
            "pair again, and if it crashes anew report it with this job's trace_id."
        )
    raise CrashError(
        f"The program crashed on these photographs ({how}); "
        "if both open elsewhere, report it with this job's trace_id."
    )
