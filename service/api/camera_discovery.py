"""Looks at cameras for the API: in child processes, with a deadline, and never while a job has one.

What was seen is in the rows of cameras, for every process of the service.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import sqlalchemy as sa
from fastapi.concurrency import run_in_threadpool

import drivers
from service.allowed import is_camera_allowed
from service.capture import CaptureSettings
from service.errors import AttemptError, NoProcessError, StorageFullError, TimeLimitError
from service.rows import cameras
from service.settings import Settings
from service.workers import host, sandbox, scratch
from service.workers.forkserver import ForkServer
from service.workers.tasks import Adjust, CameraOrder, FindCameras, Kind, Limits, LookAt, Task

WATCH_SECONDS = 0.5
"""Between two looks at the rows of cameras, one for all who watch."""

_FRESH_SECONDS = 15.0  # so long a look is good
_LOOK_SECONDS = 15.0  # what one may take
_AT_ONCE = 4  # cameras looked at
_UNANSWERED = (
    sandbox.TaskError,
    drivers.DriverError,
    StorageFullError,
    NoProcessError,
    OSError,  # a full disk, too
)
"""What leaves a look without an answer: the camera, or this machine."""

_NETWORK = "ptp+ip://"  # where the operator allows just this, cameras there announce themselves


class CameraDiscovery:
    """The cameras that this process can find, and those that the operator names."""

    def __init__(self, engine: sa.Engine, settings: Settings, server: ForkServer) -> None:
        self._engine = engine
        self._settings = settings
        self._server = server
        self._host = host.of_usb(engine)
        self._pool = ThreadPoolExecutor(1 + _AT_ONCE, "cameras")  # one waits for the others
        self._lock = threading.Lock()
        self._running: Future[None] | None = None
        self._refreshed = 0.0
        self._found: list[str] = []
        self._unable: set[str] = set()  # addresses
        self._listing: asyncio.Future[list[cameras.Camera]] | None = None
        self._listed_at = 0.0
        self._closed = False

    def close(self) -> None:
        """End what runs."""
        self._closed = True
        self._pool.shutdown(cancel_futures=True)

    def addresses(self) -> list[str]:
        """Addresses of the cameras that were found last, and of those that the operator names."""
        return [*self._found, *configured(self._settings)]

    def is_unable(self, address: str) -> bool:
        """Whether the camera took no order to release when this process last looked at it."""
        return address in self._unable

    def refresh(self) -> Future[None]:
        """Look at all cameras, unless that is done already or was just now.

        Its result raises what the database raises while it is away.
        """
        with self._lock:
            old = time.monotonic() - self._refreshed > _FRESH_SECONDS
            if self._running is None or (self._running.done() and old):
                self._running = self._pool.submit(self._look_everywhere)
            return self._running

    def listed(self) -> list[cameras.Camera]:
        """Give the cameras at addresses(), and those in use, as their rows are now."""
        with self._engine.connect() as connection:
            return cameras.find_all(connection, self.addresses())

    async def watched(self) -> list[cameras.Camera]:
        """Give what listed() does, now or just now, with one look for all who watch."""
        old = time.monotonic() - self._listed_at > WATCH_SECONDS
        if self._listing is None or (self._listing.done() and old):
            self._listed_at = time.monotonic()
            self._listing = asyncio.ensure_future(run_in_threadpool(self.listed))
        return await asyncio.shield(self._listing)

    def adjust(
        self, address: str, settings: CaptureSettings, trace_id: str
    ) -> dict[str, Any] | None:
        """Write settings of a camera; then all that it has, by name. None while it is in use.

        Raises sandbox.TaskError for what the driver says, DriverError where its process dies, and
        NoProcessError, StorageFullError or OSError where the machine has no room for one.
        """
        taken = self._take(address)
        if taken is None:
            return None
        info, answered = None, False
        try:
            told = self._run("camera_settings", Adjust(address, settings), trace_id)
            info, answered = drivers.CameraInfo(**told["info"]), True
        except sandbox.TaskError as error:
            answered = error.problem["status"] == 422  # it has said no
            raise
        finally:
            with self._engine.begin() as connection:
                cameras.give_back(connection, *taken, info, answered, self._host)
        found: dict[str, Any] = told["settings"]
        return found

    def _take(self, address: str) -> tuple[str, float] | None:
        """Have a camera for a look, where it is free: its id, and until when."""
        with self._engine.begin() as connection:
            camera = cameras.add(connection, address)
            until = cameras.take(connection, camera, 2 * _LOOK_SECONDS)
        return None if until is None else (camera, until)

    def _look_everywhere(self) -> None:
        with self._engine.begin() as connection:  # they are listed whatever comes of it
            for address in configured(self._settings):
                cameras.add(connection, address)
        with contextlib.suppress(*_UNANSWERED):
            found = self._run("cameras", FindCameras(_NETWORK in self._settings.cameras.split()))
            self._found = [one for one in found if is_camera_allowed(self._settings, one)]
        by_id = {cameras.id_of(address): address for address in self.addresses()}
        for look in [self._pool.submit(self._look, address) for address in by_id.values()]:
            look.result()
        self._refreshed = time.monotonic()

    def _look(self, address: str) -> None:
        with self._engine.connect() as connection:
            if cameras.looked_ago(connection, cameras.id_of(address)) < _FRESH_SECONDS:
                return  # another process has looked, or a job
        taken = self._take(address)
        if taken is None:
            return
        info = None
        try:
            with contextlib.suppress(*_UNANSWERED):
                told = self._run("camera", LookAt(address))
                info = drivers.CameraInfo(**told["info"])
                (self._unable.discard if told["releases"] else self._unable.add)(address)
        finally:
            with self._engine.begin() as connection:
                cameras.give_back(connection, *taken, info, info is not None, self._host)

    def _run(self, kind: Kind, order: CameraOrder, trace_id: str = "") -> Any:
        with scratch.folder(self._settings.data_dir) as folder:
            task = Task(
                kind=kind,
                job="",
                trace_id=trace_id,
                directory=str(folder),
                limits=Limits.of(self._settings, _LOOK_SECONDS),
                options={},
                camera=order,
            )
            try:
                return sandbox.run(
                    task,
                    lambda _stage, _fraction: None,
                    lambda: self._closed,
                    self._server,
                )
            except TimeLimitError as error:
                raise drivers.CameraTimeoutError(str(error)) from error
            except AttemptError as error:
                raise drivers.DriverError(str(error)) from error
            except ChildProcessError as error:
                raise drivers.DriverError(
                    "The program that asks the camera was ended: try again."
                ) from error


def configured(settings: Settings) -> list[str]:
    """Whole addresses among those that the operator allows."""
    return [each for each in settings.cameras.split() if drivers.names_one_camera(each)]
