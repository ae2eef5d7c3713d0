"""What every route needs: settings, database, queue and store of this process."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, TypeVar, TypeVarTuple

import sqlalchemy as sa
from anyio import CapacityLimiter, to_thread
from fastapi import Depends, Request

from service.api.camera_discovery import CameraDiscovery
from service.api.job_updates import JobUpdates
from service.dbos_queue.queue import Queue
from service.opening import open_database, open_storage
from service.settings import Settings
from service.storage.base import Storage
from service.workers import sandbox, scratch
from service.workers.forkserver import ForkServer

_STORING_THREADS = 40  # as many as Starlette has for all else, and so the next
_READING_THREADS = 40
_CAMERA_THREADS = 8
_PROBING_THREADS = 4

Result = TypeVar("Result")
Arguments = TypeVarTuple("Arguments")


@dataclass(frozen=True)
class Context:
    """The parts of the service that routes use."""

    settings: Settings
    engine: sa.Engine
    queue: Queue
    storage: Storage
    fork_server: ForkServer
    """Of the processes that check the headers of uploads."""
    job_updates: JobUpdates
    camera_discovery: CameraDiscovery
    checks: threading.Semaphore = field(
        default_factory=lambda: threading.Semaphore(sandbox.processors())
    )
    """Held while the headers of an upload are checked, so that many uploads share the cores."""
    storing: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_STORING_THREADS))
    """Of threads that store photographs: while a store hangs, they leave the others to the rest."""
    reading: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_READING_THREADS))
    """Of threads that read the store, for the same reason."""
    asking: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_CAMERA_THREADS))
    """Of threads that wait for cameras, for the same reason."""
    probing: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_PROBING_THREADS))
    """Of threads that look whether the database answers, for the same reason."""
    draining: threading.Event = field(default_factory=threading.Event)
    """Set once the service was told to stop: what has no end of its own ends now."""

    async def store(self, work: Callable[[*Arguments], Result], *arguments: *Arguments) -> Result:
        """Do work that changes what is stored, in a thread. Raises what it raises."""
        return await to_thread.run_sync(partial(work, *arguments), limiter=self.storing)

    async def fetch(self, work: Callable[[*Arguments], Result], *arguments: *Arguments) -> Result:
        """Do work that reads the store, in a thread. Raises what it raises."""
        return await to_thread.run_sync(partial(work, *arguments), limiter=self.reading)

    async def ask_camera(
        self, work: Callable[[*Arguments], Result], *arguments: *Arguments
    ) -> Result:
        """Do work that waits for a camera, in a thread. Raises what it raises."""
        return await to_thread.run_sync(partial(work, *arguments), limiter=self.asking)

    async def stream(self, chunks: Iterator[bytes]) -> AsyncIterator[bytes]:
        """Hand on what is read from the store piece by piece. Raises what reading raises."""
        while (chunk := await self.fetch(lambda: next(chunks, None))) is not None:
            yield chunk


@contextlib.contextmanager
def open_context(settings: Settings) -> Iterator[Context]:
    """Open the parts for as long as the block. Raises StartError."""
    with contextlib.ExitStack() as stack:
        scratch.clear(settings.data_dir)
        engine = open_database(settings)
        stack.callback(engine.dispose)
        queue = Queue(engine)
        stack.callback(queue.close)
        server = sandbox.fork_server(sandbox.processors(), pairs=False)
        stack.callback(server.close)
        storage, job_updates = open_storage(settings), JobUpdates(engine, settings)
        camera_discovery = CameraDiscovery(engine, settings, server)
        stack.callback(camera_discovery.close)
        yield Context(settings, engine, queue, storage, server, job_updates, camera_discovery)


async def _context(request: Request) -> Context:
    context: Context = request.app.state.context
    return context


async def _trace_id(request: Request) -> str:
    trace_id: str = request.state.trace_id
    return trace_id


Parts = Annotated[Context, Depends(_context)]
TraceId = Annotated[str, Depends(_trace_id)]
