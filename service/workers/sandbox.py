"""Runs one task of a job in a process of its own, so that what breaks it breaks only this job."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import cv2

from service.errors import OutputLimitError, TimeLimitError
from service.workers.deaths import check_exit, death
from service.workers.forkserver import ForkServer
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


def processors() -> int:
    """How many processors there are for this process, which in a container may be few of many."""
    return int(cv2.getNumberOfCPUs())


def fork_server(at_once: int, pairs: bool) -> ForkServer:
    """Make the server of the processes that tasks run in, for so many tasks at once.

    pairs: whether tasks separate, calibrate or mix: what that takes is imported first then.
    They share the processors: each has as many threads as there are processors for it. Variables
    that the operator has set stay.
    """
    threads = str(max(processors() // at_once, 1))
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
    and it may raise StoppedError. Raises TaskError, StoppedError, ChildProcessError, and what
    check_exit raises, NoProcessError where the task has not begun.
    """
    deadline = time.monotonic() + task.limits.seconds

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
        for message in _messages(task, process.stdout, seconds_left, is_over):
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
            raise death(task, TimeLimitError) from error
    if problem is not None:
        raise TaskError(problem)
    check_exit(task, code)
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
        raise death(task, OutputLimitError)


def _messages(
    task: Task,
    stdout: IO[bytes],
    seconds_left: Callable[[], float],
    must_stop: Callable[[], bool],
) -> Iterator[dict[str, Any]]:
    rest = b""
    with selectors.DefaultSelector() as selector:
        selector.register(stdout, selectors.EVENT_READ)
        while True:
            ready = selector.select(_LOOK_SECONDS)
            if must_stop():
                raise StoppedError
            if seconds_left() < 0:
                raise death(task, TimeLimitError)
            if not ready:
                continue
            chunk = os.read(stdout.fileno(), 65536)
            if not chunk:
                return
            *lines, rest = (rest + chunk).split(b"\n")
            yield from (json.loads(line) for line in lines)
