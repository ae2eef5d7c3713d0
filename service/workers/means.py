"""What an attempt at a job works with, and the two things that all its parts do."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import sqlalchemy as sa

from service.patience import passes, patiently
from service.rows import jobs
from service.settings import Settings
from service.storage.base import Storage
from service.workers.stopping import Stopping

Result = TypeVar("Result")

_log = logging.getLogger("service.workers.attempt")


@dataclass(frozen=True)
class Means:
    """The job, as it was claimed, and what it is worked on with. log: its lines name the job."""

    job: jobs.Job
    engine: sa.Engine
    storage: Storage
    settings: Settings
    stopping: Stopping
    log: logging.LoggerAdapter[logging.Logger]

    @classmethod
    def of(
        cls,
        job: jobs.Job,
        engine: sa.Engine,
        storage: Storage,
        settings: Settings,
        ending: Callable[[], bool],
    ) -> Means:
        """Make those of a claimed job. ending: whether its worker ends."""
        stopping = Stopping(job, engine, ending, settings.silence_seconds)
        named = {"job": job.id, "attempt": job.attempt, "trace_id": job.trace_id}
        return cls(job, engine, storage, settings, stopping, logging.LoggerAdapter(_log, named))

    def patiently(
        self, work: Callable[[], Result], may_pass: Callable[[Exception], bool] = passes
    ) -> Result:
        """Wait for what may pass, like a store that is away, but not when the job is to stop."""
        seconds = self.settings.patience_seconds
        return patiently(work, seconds, self.stopping.pause, self.log, may_pass)

    def keep(
        self,
        key: str,
        path: Path,
        headers: Mapping[str, str] | None = None,
        check: Callable[[], None] = lambda: None,
    ) -> str:
        """Store a file so that it outlasts a power cut; its SHA-256.

        headers: of its link. check: raises what is to end that, however slow the line is.
        """

        def put() -> str:
            digest = self.storage.put_file(key, path, headers, check)
            self.storage.flush([key])
            return digest

        return self.patiently(put)
