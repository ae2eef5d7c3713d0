"""The whole service in one command: the API in this process, a worker beside it."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import uvicorn

from service import logs
from service.api import create_app
from service.settings import Settings

_RESTART_SECONDS = 1.0
_STOP_SECONDS = 10.0

log = logging.getLogger("service.serve")


def serve(settings: Settings) -> None:
    """Serve until a signal says stop; nothing that was started outlives this process."""
    logs.configure()
    # uvicorn raises the signal again once it has stopped; the default would end us on the spot.
    signal.signal(signal.SIGTERM, lambda _number, _frame: sys.exit(0))
    with _worker(settings):
        serve_api(settings)


def serve_api(settings: Settings) -> None:
    """Serve the API alone, for a service whose workers run elsewhere."""
    logs.configure()
    log.info("listening on http://%s:%s", settings.host, settings.port)
    uvicorn.run(
        create_app(settings),
        host=settings.host,
        port=settings.port,
        log_config=None,
        access_log=False,
        server_header=False,
    )


@contextlib.contextmanager
def _worker(settings: Settings) -> Iterator[None]:
    stop = threading.Event()
    # The kernel ends the worker with the thread that started it, so this one stays to the end.
    keeper = threading.Thread(target=_keep_worker, args=(settings, stop), name="worker-keeper")
    keeper.start()
    try:
        yield
    finally:
        stop.set()
        keeper.join()


def _keep_worker(settings: Settings, stop: threading.Event) -> None:
    environment = {
        **os.environ,
        **{
            f"LIGHTLAYERS_{name.upper()}": str(value)
            for name, value in settings.model_dump(mode="json").items()
        },
    }
    while not stop.is_set():
        process = subprocess.Popen(
            [sys.executable, "-m", "service.worker", str(os.getpid())],
            env=environment,
            stdin=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for this process, which then ends the worker
        )
        while process.poll() is None and not stop.wait(0.2):
            pass
        if process.returncode is not None:
            log.error("the worker ended with code %s; starting another", process.returncode)
            stop.wait(_RESTART_SECONDS)
            continue
        process.terminate()
        try:
            process.wait(_STOP_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
