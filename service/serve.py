"""The whole service in one command: the API in this process, a worker beside it."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

import uvicorn

from service import logs, processes
from service.api import create_app
from service.api.context import open_context
from service.errors import StartError
from service.settings import Settings

_RESTART_SECONDS = 1.0
_STOP_SECONDS = 10.0

log = logging.getLogger("service.serve")


def serve(settings: Settings, worker: bool) -> None:
    """Serve until a signal says stop; a worker that was started does not outlive this process.

    worker: false for a service whose workers run elsewhere. Raises StartError.
    """
    logs.configure()
    with contextlib.ExitStack() as stack:
        listener = stack.enter_context(_listener(settings))
        context = stack.enter_context(open_context(settings))
        context.fork_server.start()
        # uvicorn raises the signal again once it has stopped; the default would end us on the spot.
        signal.signal(signal.SIGTERM, lambda _number, _frame: sys.exit(0))
        if worker:
            stack.enter_context(_worker(settings))
        app = create_app()
        app.state.context = context
        config = uvicorn.Config(app, log_config=None, access_log=False, server_header=False)
        host, port = listener.getsockname()[:2]
        log.info("listening on http://%s:%s", f"[{host}]" if ":" in host else host, port)
        uvicorn.Server(config).run(sockets=[listener])


def _listener(settings: Settings) -> socket.socket:
    try:
        family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
        return socket.create_server((settings.host, settings.port), family=family)
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise StartError(
            f"Port {settings.port} of {settings.host} cannot be listened on: {reason}; "
            "give another --port or --host."
        ) from error


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
            for name, value in settings.model_dump(mode="json", exclude_none=True).items()
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
        processes.end(process, _STOP_SECONDS)
