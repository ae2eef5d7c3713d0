"""Watches jobs for everybody who waits for news of them, with one look at the database for all."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import sqlalchemy as sa
from fastapi.concurrency import run_in_threadpool

from service import answers
from service.answers import JobAnswer
from service.patience import note
from service.rows import jobs
from service.rows.states import State
from service.rows.tables import jobs as rows
from service.settings import Settings

_LOOK_SECONDS = 0.25  # between two looks at the rows, one for all who watch
_PLACES_SECONDS = 2.0  # how often places in the queue are counted anew
_AT_ONCE = 500  # ids in a statement

log = logging.getLogger("service.api")


@dataclass(frozen=True)
class Snapshot:
    """A job at a moment. mark: stays the same as long as nothing has happened to it."""

    answer: JobAnswer
    revision: int
    ended: bool

    @property
    def mark(self) -> str:
        """The row's revision, and, where a job waits, its place, which changes without it."""
        place = self.answer.position
        return str(self.revision) if place is None else f"{self.revision}.{place}"


@dataclass
class Watched:
    """A job that somebody watches. latest: None before the first look."""

    latest: Snapshot | None = None
    gone: bool = False
    watchers: int = 0
    news: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def over(self) -> bool:
        """Whether nothing will happen to the job any more."""
        return self.gone or (self.latest is not None and self.latest.ended)

    async def change(self, seconds: float) -> bool:
        """Wait until there is news, for so long at most; whether there is."""
        try:
            await asyncio.wait_for(self.news.wait(), seconds)
        except TimeoutError:
            return False
        return True

    def tell(self) -> None:
        """Wake all who wait."""
        self.news.set()
        self.news = asyncio.Event()


class JobUpdates:
    """The jobs watched in this process. All but `look` belongs to one event loop."""

    def __init__(self, engine: sa.Engine, settings: Settings) -> None:
        self._engine = engine
        self._settings = settings
        self._watched: dict[str, Watched] = {}
        self._poller: asyncio.Task[None] | None = None
        self._hurry = asyncio.Event()
        self._placed = 0.0
        self.closed = False
        """Whether the service stops: who watches is to go."""

    def close(self) -> None:
        """Send everybody away who watches."""
        self.closed = True
        for watched in self._watched.values():
            watched.tell()

    @contextlib.contextmanager
    def watch(self, job_id: str) -> Iterator[Watched]:
        """Watch a job for as long as the block."""
        watched = self._watched.setdefault(job_id, Watched())
        watched.watchers += 1
        if watched.latest is None:
            self._hurry.set()
        if self._poller is None:
            self._poller = asyncio.create_task(self._poll())
        try:
            yield watched
        finally:
            watched.watchers -= 1
            if not watched.watchers:
                del self._watched[job_id]

    async def until_over(self, job_id: str, seconds: float) -> None:
        """Wait until a job has ended or is gone, or the service stops, for so long at most."""
        deadline = time.monotonic() + seconds
        with self.watch(job_id) as watched:
            while not (watched.over or self.closed):
                left = deadline - time.monotonic()
                if left <= 0:
                    return
                await watched.change(left)

    async def _poll(self) -> None:
        failed = False
        try:
            while self._watched and not self.closed:
                self._hurry.clear()
                seen = {job_id: watched.latest for job_id, watched in self._watched.items()}
                try:
                    self._take(seen, await run_in_threadpool(self.look, seen))
                    failed = False
                except Exception as error:  # they wait on: the database may come back
                    if not failed:  # one line, not one for each look
                        note(log, "jobs that are watched could not be looked at", error)
                    failed = True
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._hurry.wait(), _LOOK_SECONDS)
        finally:
            self._poller = None

    def _take(
        self, seen: Mapping[str, Snapshot | None], found: Mapping[str, Snapshot | None]
    ) -> None:
        for job_id in seen:
            watched = self._watched.get(job_id)
            if watched is None:  # nobody does any more
                continue
            snapshot = found.get(job_id)
            if job_id in found and snapshot is None:
                watched.gone = True
                watched.tell()
            elif snapshot and (watched.latest is None or watched.latest.mark != snapshot.mark):
                watched.latest = snapshot
                watched.tell()

    def look(self, seen: Mapping[str, Snapshot | None]) -> dict[str, Snapshot | None]:
        """Look for what has changed since; None for jobs that are gone. Called in a thread."""
        places_too = time.monotonic() - self._placed > _PLACES_SECONDS
        if places_too:
            self._placed = time.monotonic()
        found: dict[str, Snapshot | None] = {}
        ids = list(seen)
        with self._engine.connect() as connection:
            for start in range(0, len(ids), _AT_ONCE):
                some = {job_id: seen[job_id] for job_id in ids[start : start + _AT_ONCE]}
                found |= self._look_at(connection, some, places_too)
        return found

    def _look_at(
        self, connection: sa.Connection, seen: Mapping[str, Snapshot | None], places_too: bool
    ) -> dict[str, Snapshot | None]:
        short = sa.select(rows.c.id, rows.c.revision, rows.c.state).where(rows.c.id.in_(seen))
        known = {row.id: row for row in connection.execute(short)}
        changed = []
        for job_id, row in known.items():
            last = seen[job_id]
            if (
                last is None
                or last.revision != row.revision
                or (places_too and row.state == State.QUEUED)
            ):
                changed.append(job_id)
        found: dict[str, Snapshot | None] = dict.fromkeys(set(seen) - set(known))
        if changed:
            looked_at = jobs.find_all(connection, changed)
            told = answers.of_jobs(connection, self._settings, looked_at)
            for job, answer in zip(looked_at, told, strict=True):
                found[job.id] = Snapshot(answer, job.revision, job.ended)
        return found
