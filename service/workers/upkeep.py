"""What a worker does at heartbeats and sweeps, for itself and for workers that have died."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

import sqlalchemy as sa

from service import counters, webhooks
from service.dbos_queue.entries import Held
from service.dbos_queue.queue import Queue
from service.errors import DeadlineError, StartError
from service.patience import note
from service.problems import cause_of, problem_of
from service.retention import Sweep
from service.rows import database, heartbeats, jobs, waiting
from service.settings import Settings
from service.storage.base import Storage
from service.workers import presence

_OVERDUE_AT_ONCE = 100  # the rest can wait for the next heartbeat, which must not be late

log = logging.getLogger("service.workers.upkeep")


class Upkeep:
    """The upkeep of one worker. What hinders it is written to the log, and the next one goes on.

    worker: its id. running: gives what the queues have called it for, each by Held.work.
    """

    def __init__(
        self,
        worker: str,
        engine: sa.Engine,
        storage: Storage,
        queue: Queue,
        settings: Settings,
        running: Callable[[], set[str]],
    ) -> None:
        self._worker = worker
        self._engine = engine
        self._queue = queue
        self._settings = settings
        self._running = running
        self._sweeping = Sweep(engine, storage, queue, settings)
        self._idle: set[Held] = set()
        """What the queues have given to this worker, without calling it yet."""

    def enter(self) -> None:
        """Say for the first time that this worker lives. Raises StartError."""
        presence.enter(self._settings.data_dir, self._worker)
        try:
            self._beat()
        except sa.exc.DBAPIError as error:
            self._make_room(error)  # for the next start
            raise StartError(
                "The database of jobs cannot be written: make room on its disk, or check "
                f"LIGHTLAYERS_DATABASE_URL ({cause_of(error)})."
            ) from error

    def keep(self) -> None:
        """Do one heartbeat, and what there is to do for others and for jobs that wait."""
        try:
            self._beat()
            self._bury()
            self._take_over()
            self._fail_overdue()
            self.queue_deliveries()
        except Exception as error:  # the next heartbeat may find the database there again
            note(log, "the heartbeat was cut short", error, worker=self._worker)
            self._make_room(error)

    def sweep(self, thorough: bool) -> None:
        """Remove what is due, or as much as can be; thorough: see Sweep.run."""
        try:
            self._sweeping.run(thorough)
        except Exception as error:  # the next one does what this one has left
            note(log, "the sweep was cut short", error, worker=self._worker)
            self._make_room(error)

    def queue_deliveries(self) -> None:
        """Queue the deliveries to webhooks that are due. Raises what the database raises."""
        with self._engine.begin() as connection:
            webhooks.queue_deliveries(connection, self._queue)

    def leave(self) -> None:
        """Say that this worker ends."""
        try:
            with self._engine.begin() as connection:
                heartbeats.leave(connection, self._worker)
            presence.leave(self._settings.data_dir, self._worker)
        except Exception as error:  # others find out by the process's lock, or its silence
            note(log, "left without a word", error, worker=self._worker)

    def _beat(self) -> None:
        with self._engine.begin() as connection:
            heartbeats.beat(connection, self._worker)

    def _bury(self) -> None:
        """Forget the workers of this machine that have died."""
        for worker in presence.dead(self._settings.data_dir):
            with self._engine.begin() as connection:
                heartbeats.leave(connection, worker)

    def _take_over(self) -> None:
        """Put back into their queues what dead workers had, and what this one does not know of."""
        held = self._queue.held()  # first: whoever holds something has beaten before
        with self._engine.begin() as connection:
            living = heartbeats.living(connection, self._settings.silence_seconds)
            dead = {one for one in held if one.worker not in living}
            lost = jobs.held(connection, {one.job for one in dead if one.runs})
        forgotten = self._forgotten(held)
        self._queue.put_back(dead | forgotten)
        # A worker that was stopped has put its jobs back itself, but for their queue's entries.
        taken = {one for one in dead if one.job in lost or not one.runs}
        for one in taken:
            log.warning("taken over", extra={"job": one.job, "worker": self._worker})
            counters.TAKEOVERS.inc(one.runs)
        for one in forgotten | (dead - taken):
            log.warning("put back", extra={"job": one.job, "worker": self._worker})

    def _forgotten(self, held: Iterable[Held]) -> set[Held]:
        """Find what this worker took out of the queues without learning of it.

        The database's answer got lost on the way.
        """
        running = self._running()
        idle = {one for one in held if one.worker == self._worker and one.work not in running}
        # What came out just now is called for in a moment.
        forgotten, self._idle = idle & self._idle, idle
        return forgotten

    def _fail_overdue(self) -> None:
        """End jobs that wait past their deadlines; their attempts end those that run."""
        failed: dict[str, str] = {}
        keep_seconds = self._settings.retention_seconds
        with self._engine.begin() as connection:
            for job_id, trace_id in waiting.overdue(connection, _OVERDUE_AT_ONCE):
                problem = problem_of(DeadlineError(), trace_id)
                if jobs.fail_waiting(connection, job_id, problem.model_dump(), keep_seconds):
                    failed[job_id] = problem.type
        for job_id, problem_type in failed.items():
            log.info("failed: %s", problem_type, extra={"job": job_id})
        if failed:
            self._queue.withdraw(*failed)

    def _make_room(self, error: Exception) -> None:
        """Remove files where an error is that of a database whose disk is full.

        No sweep would: on such a disk none can be taken out of its queue.
        """
        if not database.is_full(error):
            return
        try:
            self._sweeping.make_room()
        except Exception as failure:  # the next heartbeat tries again
            note(log, "making room was cut short", failure, worker=self._worker)
