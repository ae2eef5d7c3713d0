"""The process of one task of a job, its task as JSON on stdin.

python -m service.workers.child imports once, and forks such a process for every task
(service.workers.forking); with the argument PAIRS it imports what separates, calibrates and
mixes as well. It writes one JSON object per line to stdout: {"stage", "fraction"} while it works,
{"question"} where it then waits for a line of JSON on stdin, {"answer"} with what it found,
{"problem"} before it ends with nothing to show, except for want of memory, files or disk, which
its exit code tells. Exit code 0 means that all is done.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import json
import logging
import os
import resource
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipeline import compiling
from pipeline.pair.pair_checks import check_pair
from service import logs, problems
from service.workers import camera_tasks, forking
from service.workers.exit_codes import DISK_FULL, OUT_OF_FILES, OUT_OF_MEMORY
from service.workers.shortage import wants_memory
from service.workers.tasks import PAIRS, Kind, Limits, Task, Tell

_CODES = {
    errno.EMFILE: OUT_OF_FILES,
    errno.ENOSPC: DISK_FULL,
    errno.EDQUOT: DISK_FULL,
}

log = logging.getLogger("service.workers.child")


def main() -> int:
    """Run the task that stdin describes."""
    task = Task.from_json(sys.stdin.readline())
    tell = _take_stdout()
    try:
        _limit(task.limits)
        _work(task.kind)(task, tell)
    except Exception as error:
        if wants_memory(error):
            return OUT_OF_MEMORY
        if isinstance(error, OSError) and error.errno in _CODES:
            return _CODES[error.errno]
        tell({"problem": _explain(error, task)})
        return 1
    return 0


def _limit(limits: Limits) -> None:
    _set(resource.RLIMIT_AS, limits.memory_bytes, limits.memory_bytes)
    # SIGXCPU at the first limit tells why it ended; SIGKILL at the second one would not.
    _set(resource.RLIMIT_CPU, limits.cpu_seconds, limits.cpu_seconds + 5)
    _set(resource.RLIMIT_NOFILE, limits.open_files, limits.open_files)
    _set(resource.RLIMIT_FSIZE, limits.output_bytes, limits.output_bytes)
    # Python ignores it, and what libraries of C++ make of a failed write tells nobody why.
    signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
    _set(resource.RLIMIT_CORE, 0, 0)
    # When the machine itself runs out of memory, this process goes first, not the service.
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")


def _set(limit: int, soft: int, hard: int) -> None:
    """Set a limit of this process, or as much of it as the system lets it have."""
    try:
        resource.setrlimit(limit, (soft, hard))
    except ValueError:  # `lightlayers doctor` tells the operator
        _, most = resource.getrlimit(limit)
        resource.setrlimit(limit, (min(soft, most), most))


def _explain(error: Exception, task: Task) -> dict[str, Any]:
    if problems.kind_of(error) is problems.INTERNAL:
        log.error(
            "task failed",
            exc_info=error,
            extra={"job": task.job, "trace_id": task.trace_id},
        )
    return problems.problem_of(error, task.trace_id).model_dump()


def _take_stdout() -> Tell:
    # What libraries print goes to stderr, so that it cannot break the lines.
    pipe = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    os.dup2(2, 1)

    def tell(message: dict[str, Any]) -> None:
        pipe.write(json.dumps(message) + "\n")

    return tell


def _check(task: Task, _tell: Tell) -> None:
    check_pair(task.photograph("no_flash"), task.photograph("flash"))


_QUICK: dict[Kind, Callable[[Task, Tell], None]] = {
    "check": _check,
    "capture": camera_tasks.capture,
    "cameras": camera_tasks.find,
    "camera": camera_tasks.describe,
    "camera_settings": camera_tasks.adjust,
}


def _work(kind: Kind) -> Callable[[Task, Tell], None]:
    if kind in _QUICK:
        return _QUICK[kind]
    from service.workers import pair_tasks  # where PAIRS was asked for, it is there already

    return pair_tasks.WORK[kind]


if __name__ == "__main__":
    logs.configure()  # of the server and of its children
    if sys.argv[1:] == [PAIRS]:
        # the second, or each job with normals would
        for name in ("service.workers.pair_tasks", "pipeline.photometric_stereo.normals"):
            importlib.import_module(name)
        compiling.prepare()
    forking.serve()
    code = main()
    sys.stdout.flush()
    # Taking the interpreter down would touch, and so copy, what is shared with the fork server.
    os._exit(code)
