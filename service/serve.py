"""The whole service in one command: the API in this process, a worker beside it."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import signal
import socket
import sys
import threading
import time
from types import FrameType

import uvicorn
from obstore.exceptions import BaseError

from pipeline.errors import reason_of
from service import belonging, logs, metrics, room, tracing, upload_pieces
from service.api import create_app
from service.api.context import Context, open_context
from service.connections import PatientProtocol
from service.errors import StartError
from service.kept_worker import kept_worker
from service.memory_pools import share_memory
from service.problems import cause_of
from service.rows import keys
from service.rows.database import AWAY
from service.settings import Settings
from service.variables import faults

_HEAD_BYTES = 32 * 1024  # of a request
_MEMORY_POOLS = 2  # see share_memory

log = logging.getLogger("service.serve")


def serve(settings: Settings, worker: bool) -> None:
    """Serve until a signal says stop; a worker that was started does not outlive this process.

    worker: false for a service whose workers run elsewhere. SIGTERM and SIGINT end the process from
    here, with 0 and 130. Raises StartError.
    """
    try:
        _serve(settings, worker)
    except SystemExit as stop:
        _end(stop.code if isinstance(stop.code, int) else 0)
    except KeyboardInterrupt:
        _end(128 + signal.SIGINT)


def _end(code: int) -> None:
    """End the process at once: threads that a store holds up would keep it for minutes."""
    tracing.flush()
    logging.shutdown()
    os._exit(code)


def _serve(settings: Settings, worker: bool) -> None:
    share_memory(_MEMORY_POOLS)
    logs.configure()
    for sentence in faults():
        log.warning("%s", sentence)
    tracing.configure("api")
    with contextlib.ExitStack() as stack:
        listener = stack.enter_context(_listener(settings))
        if worker:
            _check_metrics(settings, listener)
        context = stack.enter_context(open_context(settings))
        _check_keys(context)
        _check_room(context)
        metrics.serve(settings, context.engine)
        context.fork_server.start()
        _remove_expired(context)
        # uvicorn raises the signal again once it has stopped; the default would end us on the spot.
        signal.signal(signal.SIGTERM, lambda _number, _frame: sys.exit(0))
        stopping = threading.Event()
        if worker:
            stack.enter_context(kept_worker(settings, stopping))
        host, port = listener.getsockname()[:2]
        log.info("listening on http://%s:%s", f"[{host}]" if ":" in host else host, port)
        _server(context, stopping).run(sockets=[listener])


def _server(context: Context, stopping: threading.Event) -> _Server:
    settings = context.settings
    app = create_app(settings.origins.split())
    app.state.context = context
    config = uvicorn.Config(
        app,
        http=PatientProtocol,
        ws="none",
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=math.ceil(settings.stop_seconds),
        h11_max_incomplete_event_size=_HEAD_BYTES,
        # Idle connections count, too; the app itself refuses requests, with a better answer.
        limit_concurrency=2 * settings.requests,
    )
    return _Server(config, context, settings.drain_seconds, stopping)


class _Server(uvicorn.Server):
    """Goes on for a while after the first signal; the second one ends that.

    At the end it sends those away who watch jobs, for whom it would wait for ever, and says that it
    stops: a worker ends while the last requests are finished.
    """

    def __init__(
        self, config: uvicorn.Config, context: Context, seconds: float, stopping: threading.Event
    ) -> None:
        super().__init__(config)
        self._context = context
        self._seconds = seconds
        self._stopping = stopping
        self._end: float | None = None

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to drain, or stop at once."""
        self._context.draining.set()
        if self._end is None and self._seconds:
            self._end = time.monotonic() + self._seconds
            log.info("draining")
        else:
            super().handle_exit(sig, frame)

    async def on_tick(self, counter: int) -> bool:
        """Tell, several times a second, whether it is time to stop."""
        if self._end is not None and time.monotonic() >= self._end:
            self.should_exit = True
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End, worker and watchers first."""
        self._stopping.set()
        self._context.job_updates.close()
        await super().shutdown(sockets)


def _check_keys(context: Context) -> None:
    if not keys.required(context.settings):
        return
    with context.engine.connect() as connection:
        if keys.any_usable(connection):
            return
    raise StartError(
        "This service needs keys, and there is none that is good: make one with `lightlayers keys "
        "create NAME` and the same LIGHTLAYERS_ settings, or listen on 127.0.0.1 alone."
    )


def _check_metrics(settings: Settings, listener: socket.socket) -> None:
    port = settings.worker_metrics_port
    if port == listener.getsockname()[1]:
        raise StartError(
            f"The worker's metrics take port {port}, one above LIGHTLAYERS_METRICS_PORT, which is "
            "that of the service; set another."
        )


def _check_room(context: Context) -> None:
    with contextlib.suppress(BaseError):  # a disk that does not tell is the first request's matter
        room.check_setting(context.settings, context.storage)


def _remove_expired(context: Context) -> None:
    try:
        ours = belonging.claim(context.engine, context.storage)  # before its first job is stored
        upload_pieces.remove_expired(context.engine, context.storage, strays=ours)
    except (*AWAY, BaseError) as error:
        # The sweep of each hour does it, too; on a full disk it takes this API to delete jobs.
        log.warning("uploads that have expired stay until the next sweep: %s", cause_of(error))


def _listener(settings: Settings) -> socket.socket:
    try:
        family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
        listener = socket.create_server((settings.host, settings.port), family=family)
    except OSError as error:
        raise StartError(
            f"Port {settings.port} of {settings.host} cannot be listened on: {reason_of(error)}; "
            "give another --port or --host."
        ) from error
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux; connections have it from here
        pause = int(settings.pause_seconds * 1000)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, pause)
    return listener
