"""What stands in the queues: their names, those of the work, and the ids of its entries.

They are in databases, and workers of the version before read them: none may change.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

APPLICATION = "lightlayers"
VERSION = "1"
"""Pinned: a job of an older program may be run by a newer one."""

JOBS = "jobs"
"""The queue of jobs."""

CAPTURES = "captures"
"""The queues of cameras, one each: jobs wait here until theirs has taken their pair.

Those that hang on a host's USB have theirs in a queue of that host, see captures_on.
"""

DELIVERIES = "webhooks"
"""The queue of attempts at delivery to webhooks."""

UPKEEP = "upkeep"
"""The queue of sweeps."""

RUN_JOB, CAPTURE_PAIR, TELL_WEBHOOK, SWEEP = "run_job", "capture_pair", "tell_webhook", "sweep"
"""The work that is done for an entry of each of these queues, in the same order."""

_AGAIN = re.compile(r"-again-(\d+)$")  # as run_id makes them
_OF_A_JOB = re.compile(r"-(capture|(again|webhook)-\d+)$")  # as capture_id and delivery_id do


@dataclass(frozen=True)
class Held:
    """What a worker has taken out of a queue; in that of jobs, id is as run_id makes it."""

    id: str
    worker: str
    queue: str

    @property
    def work(self) -> str:
        """Name of the work, done once at a time: the id without how often it was put back."""
        return _AGAIN.sub("", self.id)

    @property
    def job(self) -> str:
        """Id of the job that it is about; of a sweep, its own."""
        return _OF_A_JOB.sub("", self.id)

    @property
    def runs(self) -> bool:
        """Whether it is a job itself, or its capture."""
        return self.queue not in (DELIVERIES, UPKEEP)


def captures_on(host: str | None) -> str:
    """Name the queue of the cameras on a host's USB; None: of those that any worker can use."""
    return CAPTURES if host is None else f"{CAPTURES}@{host}"


def run_id(job_id: str, again: int = 0) -> str:
    """Give the id that a job has in the queue of jobs: its own, until it is put back."""
    return f"{job_id}-again-{again}" if again else job_id


def capture_id(job_id: str) -> str:
    """Give the id that a job has in its camera's queue."""
    return f"{job_id}-capture"


def delivery_id(job_id: str, number: int) -> str:
    """Give the id that an attempt at delivery to a job's webhook has in its queue."""
    return f"{job_id}-webhook-{number}"


def sweep_id(kind: str, span: int) -> str:
    """Give the id of the one sweep of a kind in a span of time, counted from 1970."""
    return f"{SWEEP}-{kind}-{span}"


def times_put_back(run: str) -> int:
    """Tell how many times a job was put back, by its id in the queue of jobs."""
    number = _AGAIN.search(run)
    return int(number[1]) if number else 0
