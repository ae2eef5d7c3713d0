"""What it costs to start the process of a task, and how tasks at once share the processors.

Tasks run as a worker runs them: sandbox.run, in processes that a fork server forks.
"""

from __future__ import annotations

import contextlib
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import Any, Literal

from service.frames import FRAMES
from service.settings import Settings
from service.workers import sandbox
from service.workers.forkserver import ForkServer
from service.workers.tasks import Limits, Task
from tests.bench.usage import python, run

_TASKS = 40
_BARE = python("-c", "pass")


def start(files: Sequence[Path], tasks: int = _TASKS) -> dict[str, float]:
    """Seconds until the first byte of a separation's work, and CPU of a task that only checks.

    `bare_…`: of a Python process that does nothing, by turns. files: the pair, without the flash
    first.
    """
    firsts, bare = [], []
    with _inputs(files) as folder, contextlib.closing(sandbox.fork_server(1, pairs=True)) as server:
        _check(server, folder)  # waits until it has imported
        for _ in range(tasks):
            firsts.append(_first_byte(server, folder))
            bare.append(run(_BARE))
        cpu = (_cpu_of_checks(folder, 1 + tasks) - _cpu_of_checks(folder, 1)) / tasks
    return {
        "first_byte_s": median(firsts),
        "worst_first_byte_s": max(firsts),
        "cpu_s": cpu,
        "bare_wall_s": median(one.wall_s for one in bare),
        "bare_cpu_s": median(one.cpu_s for one in bare),
    }


def two_at_once(files: Sequence[Path], options: dict[str, Any]) -> dict[str, float]:
    """Two separations at once over one after the other: `speedup` in throughput, `cpu_ratio`."""
    seconds, cpu = {}, {}
    for at_once in (1, 2):
        before = _cpu_of_ended()
        with contextlib.closing(sandbox.fork_server(at_once, pairs=True)) as server:
            with _inputs(files) as folder:
                _check(server, folder)
            begin = time.monotonic()
            with ThreadPoolExecutor(at_once) as pool:
                for done in [pool.submit(_separate, server, files, options) for _ in range(2)]:
                    done.result()
            seconds[at_once] = time.monotonic() - begin
        cpu[at_once] = _cpu_of_ended() - before
    return {"speedup": seconds[1] / seconds[2], "cpu_ratio": cpu[2] / cpu[1]}


def _separate(server: ForkServer, files: Sequence[Path], options: dict[str, Any]) -> None:
    with _inputs(files) as folder:
        sandbox.run(_task("separate", folder, options), _ignore, lambda: False, server)


def _first_byte(server: ForkServer, folder: Path) -> float:
    arrived: list[float] = []
    begin = time.monotonic()
    with contextlib.suppress(sandbox.StoppedError):
        sandbox.run(
            _task("separate", folder),
            lambda _stage, _fraction: arrived.append(time.monotonic()),
            lambda: bool(arrived),
            server,
        )
    return arrived[0] - begin


def _cpu_of_checks(folder: Path, count: int) -> float:
    """CPU seconds of a fork server and so many tasks, from its start to its end."""
    before = _cpu_of_ended()
    with contextlib.closing(sandbox.fork_server(1, pairs=True)) as server:
        for _ in range(count):
            _check(server, folder)
    return _cpu_of_ended() - before


def _cpu_of_ended() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _check(server: ForkServer, folder: Path) -> None:
    sandbox.run(_task("check", folder), _ignore, lambda: False, server)


def _task(
    kind: Literal["check", "separate"], folder: Path, options: dict[str, Any] | None = None
) -> Task:
    limits = Limits.of(Settings(), 900)
    return Task(kind, "bench", "0" * 32, str(folder), limits, options or {})


def _ignore(_stage: str, _fraction: float) -> None:
    pass


@contextlib.contextmanager
def _inputs(files: Sequence[Path]) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        for frame, path in zip(FRAMES, files, strict=True):
            shutil.copyfile(path, Path(folder) / frame)
        yield Path(folder)
