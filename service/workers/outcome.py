"""What becomes of an attempt: its end in the row of the job, and of its files those that count."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import partial
from typing import Any

import sqlalchemy as sa
from obstore.exceptions import BaseError

from service import tracing
from service.object_keys import captured_key, job_key, results_key
from service.rows import attempts, jobs
from service.rows.states import State
from service.workers.means import Means

PassOn = Callable[[sa.Connection], None]
"""Queues the rest of a job in the transaction that puts it back."""


class Outcome:
    """The outcome of one attempt; each write tells whether the attempt still counts."""

    def __init__(self, means: Means) -> None:
        job, self._job, self._means = means.job, means.job, means
        kept_on = job.task == "calibrate" and job.options.get("setup")
        self._keep_seconds = None if kept_on else means.settings.retention_seconds

    def succeed(self, results: list[dict[str, Any]], stage_seconds: dict[str, float]) -> bool:
        """End the job with its files; whether this counts. stage_seconds: what each stage took."""
        counts = self._end(partial(attempts.succeed, stage_seconds=stage_seconds), results)
        if counts:
            self._means.log.info("succeeded")
            tracing.note("outcome", "succeeded")
        return counts

    def fail(self, problem: dict[str, Any]) -> bool:
        """End the job with a problem; whether this counts."""
        counts = self._end(attempts.fail, problem)
        if counts:
            self._means.log.info("failed: %s", problem["type"])
            tracing.note("outcome", problem["type"])
            with contextlib.suppress(BaseError):  # what is left of them here goes with the job
                self._means.storage.delete_below(results_key(self._job.id, self._job.attempt))
        return counts

    def put_back(self, pass_on: PassOn) -> bool:
        """Put the job back, and have it passed on; whether this counts."""

        def write() -> bool:
            with self._means.engine.begin() as connection:
                counts = attempts.release(connection, self._job)
                if counts:
                    pass_on(connection)
                return counts

        return self._means.patiently(write)

    def give_up(self, lost: bool = False) -> None:
        """End an attempt that was canceled, taken over, deleted, or put back by a worker's end.

        One that has ended the job stays as it is. lost: whether it counts as one that the job lost.
        Files of it that are not ours to delete stay: a worker tries again whatever is raised.
        """
        with self._means.engine.begin() as connection:
            canceled = attempts.acknowledge_cancel(connection, self._job, self._keep_seconds)
            if lost:  # either puts back what has not ended
                attempts.lose(connection, self._job)
            else:
                attempts.release(connection, self._job)
            row = jobs.find(connection, self._job.id)
        if canceled:
            self._means.log.info("canceled")
            tracing.note("outcome", "canceled")
        if row is None:
            self._clear(job_key(self._job.id))
        elif row.attempt != self._job.attempt or row.state != State.SUCCEEDED:
            self._clear(results_key(self._job.id, self._job.attempt))
            if self._job.capture and not row.has_pair_of(self._job.attempt):
                self._clear(captured_key(self._job.id, self._job.attempt))
            self._clear_lost()

    def _end(self, end: Callable[..., bool], outcome: Any) -> bool:
        """Write the job's end, once the database is there; whether it counts."""

        def write() -> bool:
            with self._means.engine.begin() as connection:
                counts = end(connection, self._job, outcome, keep_seconds=self._keep_seconds)
                return counts or self._counted(connection)

        counts = self._means.patiently(write)
        if counts:
            self._clear_lost()
        return counts

    def _counted(self, connection: sa.Connection) -> bool:
        """Whether this attempt has ended the job already: the answer to that may have been lost."""
        row = jobs.find(connection, self._job.id)
        return (
            row is not None
            and row.attempt == self._job.attempt
            and row.state in (State.SUCCEEDED, State.FAILED)
        )

    def _clear_lost(self) -> None:
        """Delete what earlier attempts have left, which no quota counts: else it stays for ever."""
        # What is left of them here goes with the job.
        with contextlib.suppress(BaseError):
            for lost in range(1, self._job.attempt):
                self._means.storage.delete_below(results_key(self._job.id, lost))
                if self._job.capture and not self._job.has_pair_of(lost):
                    self._means.storage.delete_below(captured_key(self._job.id, lost))

    def _clear(self, prefix: str) -> None:
        if not self._means.storage.try_delete_below(prefix):
            self._means.log.warning("files of an attempt that does not count cannot be deleted")
