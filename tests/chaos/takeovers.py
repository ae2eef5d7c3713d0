"""How long jobs of a worker that was killed, frozen or cut off wait for their next attempt."""

# ruff: noqa: T201  part of a command

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field

import sqlalchemy as sa

from service.rows import tables
from service.rows.states import HELD
from tests.chaos.processes import Process

_LOOK_SECONDS = 0.1
_PATIENCE_SECONDS = 30.0


@dataclass
class Takeovers:
    """Watches the rows of jobs that lost their worker, until `stop` is set."""

    engine: sa.Engine
    seconds: list[float] = field(default_factory=list)
    """Until the next attempt had begun: that may have waited for a worker that was busy."""
    lost_at: list[tuple[str, float]] = field(default_factory=list)
    """Which jobs those are, and when they lost their worker, in seconds since 1970."""
    losses: dict[str, int] = field(default_factory=dict)
    """How often a job has lost its worker or its process to us."""
    _waiting: dict[tuple[str, int], float] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def held_by(self, workers: Iterable[Process]) -> list[tuple[str, int]]:
        """Jobs and attempts that these worker processes have."""
        marks = [f"-{worker.pid}-" for worker in workers]
        rows = self._rows(tables.jobs.c.state.in_(HELD))
        return [
            (row.id, row.attempt)
            for row in rows
            if row.worker and any(mark in row.worker for mark in marks)
        ]

    def lost(self, jobs: Iterable[tuple[str, int]], timed: bool = True) -> None:
        """Note that these attempts are over, as of now; timed: somebody else is to go on."""
        with self._lock:
            for job_id, attempt in jobs:
                self.losses[job_id] = self.losses.get(job_id, 0) + 1
                if timed:
                    self._waiting.setdefault((job_id, attempt), time.monotonic())

    def back(self, workers: Iterable[Process]) -> None:
        """Note that these workers go on with what nobody else could take over."""
        held = set(self.held_by(workers))
        with self._lock:
            for one in held & self._waiting.keys():
                del self._waiting[one]

    def watch(self, stop: threading.Event) -> None:
        """Look at the waiting ones again and again."""
        while not stop.wait(_LOOK_SECONDS):
            with self._lock:
                waiting = list(self._waiting)
            if waiting:
                rows = self._rows(tables.jobs.c.id.in_([job_id for job_id, _ in waiting]))
                self._note({row.id: row for row in rows})

    def _note(self, rows: dict[str, sa.Row[tuple[object, ...]]]) -> None:
        with self._lock:
            for (job_id, attempt), since in list(self._waiting.items()):
                row = rows.get(job_id)
                if row is not None and row.attempt > attempt:
                    took = time.monotonic() - since
                    self.seconds.append(took)
                    self.lost_at.append((job_id, time.time() - took))
                    print(f"          {job_id} was taken over after {took:.1f} s", flush=True)
                elif row is not None and row.state in HELD:
                    continue
                del self._waiting[job_id, attempt]

    def _rows(self, which: sa.ColumnElement[bool]) -> list[sa.Row[tuple[object, ...]]]:
        columns = [tables.jobs.c[name] for name in ("id", "attempt", "state", "worker")]
        deadline = time.monotonic() + _PATIENCE_SECONDS
        while True:
            with contextlib.suppress(sa.exc.DBAPIError), self.engine.connect() as connection:
                return list(connection.execute(sa.select(*columns).where(which)))
            if time.monotonic() > deadline:
                raise TimeoutError("the database does not answer")
            time.sleep(_LOOK_SECONDS)
