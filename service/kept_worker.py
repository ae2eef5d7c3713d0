"""The worker beside the API in one command: started, started again when it ends, and stopped."""

from __future__ import annotations

import contextlib
import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping

from pipeline.errors import reason_of
from service.settings import Settings
from service.workers import processes

_RESTART_SECONDS = 1.0  # twice as long after each start in vain, up to the second
_LONGEST_RESTART_SECONDS = 60.0
_LASTING_SECONDS = 10.0  # a worker that lived for so long had begun
_STOP_SECONDS = 20.0  # a worker takes up to 15

log = logging.getLogger("service.serve")


@contextlib.contextmanager
def kept_worker(settings: Settings, stop: threading.Event) -> Iterator[None]:
    """Keep a worker running until the end of the block, or until `stop` is set if that is sooner.

    settings: those of this process, ports of metrics apart.
    """
    # The kernel ends the worker with the thread that started it, so this one stays to the end.
    keeper = threading.Thread(target=_keep_worker, args=(settings, stop), name="worker-keeper")
    keeper.start()
    try:
        yield
    finally:
        stop.set()
        keeper.join()


def _keep_worker(settings: Settings, stop: threading.Event) -> None:
    environment = _environment_of(settings)
    pause, told = _RESTART_SECONDS, None
    while not stop.is_set():
        began = time.monotonic()
        end = _run_worker(environment, stop)
        if end is None:
            return
        if time.monotonic() - began >= _LASTING_SECONDS:
            pause, told = _RESTART_SECONDS, None
        if end != told:
            told = end
            log.error(
                "the worker %s; starting another in %g s, and ever less often, each %g s at last, "
                "while they end so at once",
                told,
                pause,
                _LONGEST_RESTART_SECONDS,
            )
        stop.wait(pause)
        pause = min(2 * pause, _LONGEST_RESTART_SECONDS)


def _environment_of(settings: Settings) -> dict[str, str]:
    """The variables that a worker reads these settings from."""
    own = settings.model_dump(mode="json", exclude_none=True)
    own |= {"metrics_port": settings.worker_metrics_port} if settings.metrics_port else {}
    return os.environ | {f"LIGHTLAYERS_{name.upper()}": str(value) for name, value in own.items()}


def _run_worker(environment: Mapping[str, str], stop: threading.Event) -> str | None:
    """Run a worker until it ends, and say in a few words how; None where it was told to stop."""
    try:
        process = subprocess.Popen(
            [sys.executable, "-m", "service.workers.worker", str(os.getpid())],
            env=environment,
            stdin=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for this process, which then ends the worker
        )
    except OSError as error:  # out of processes, memory or open files, which may pass
        return f"could not be started, {reason_of(error)}"
    while process.poll() is None and not stop.wait(0.2):
        pass
    if process.returncode is not None:
        return f"ended with code {process.returncode}"
    processes.end(process, _STOP_SECONDS)
    return None
