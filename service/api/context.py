"""What every route needs: settings, database, queue and store of this process."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass, field
from typing import Annotated

import sqlalchemy as sa
from fastapi import Depends, Request

from service.engine import Queue
from service.settings import Settings
from service.storage import Storage


@dataclass(frozen=True)
class Context:
    """The parts of the service that routes use; opened when the app starts."""

    settings: Settings
    engine: sa.Engine
    queue: Queue
    storage: Storage
    checks: threading.Semaphore = field(
        default_factory=lambda: threading.Semaphore(os.cpu_count() or 1)
    )
    """Held while the headers of an upload are checked, so that many uploads share the cores."""


def _context(request: Request) -> Context:
    context: Context = request.app.state.context
    return context


def _trace_id(request: Request) -> str:
    trace_id: str = request.state.trace_id
    return trace_id


Parts = Annotated[Context, Depends(_context)]
TraceId = Annotated[str, Depends(_trace_id)]
