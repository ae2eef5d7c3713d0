"""Whether an attempt is to stop, asked often and looked up seldom."""

from __future__ import annotations

import time
from collections.abc import Callable

import sqlalchemy as sa

from service.errors import DeadlineError
from service.rows import attempts, jobs
from service.rows.database import AWAY
from service.workers import sandbox

ASK_SECONDS = 0.25
"""Between two looks at the job's row."""


class Stopping:
    """Ends an attempt whose job was canceled, taken over, deleted or is late, or whose worker ends.

    ending: whether the worker ends. silence_seconds: how long a worker may be silent before others
    take its jobs over.
    """

    def __init__(
        self,
        job: jobs.Job,
        engine: sa.Engine,
        ending: Callable[[], bool],
        silence_seconds: float,
    ) -> None:
        self._job = job
        self._engine = engine
        self._ending = ending
        self._silence_seconds = silence_seconds
        self._asked = 0.0
        self._is_due = False
        self._heard = time.monotonic()

    def is_due(self) -> bool:
        """Whether to stop. Raises DeadlineError, and AWAY when others take the job over."""
        if self._ending():
            return True
        if time.monotonic() - self._asked > ASK_SECONDS:
            self._asked = time.monotonic()
            try:
                self._is_due = self._look()
                self._heard = time.monotonic()
            except AWAY:
                # Others take the job over after so long a silence.
                if time.monotonic() - self._heard > self._silence_seconds:
                    raise
        return self._is_due

    def check(self) -> None:
        """Raise sandbox.StoppedError, or what is_due raises, where going on has no point."""
        if self.is_due():
            raise sandbox.StoppedError

    def pause(self, seconds: float) -> None:
        """Wait for so many seconds. Raises what check raises meanwhile."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0:
            self.check()
            time.sleep(min(left, ASK_SECONDS))

    def is_void(self) -> bool:
        """Whether what the attempt does counts no more, as the job's row says now."""
        with self._engine.connect() as connection:
            return attempts.must_stop(connection, self._job)

    def _look(self) -> bool:
        with self._engine.connect() as connection:
            stop = attempts.must_stop(connection, self._job)
            late = self._job.deadline is not None and attempts.is_late(connection, self._job)
        if late and not stop:
            raise DeadlineError
        return stop
