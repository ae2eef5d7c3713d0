"""Counts of jobs and workers for those who run the service; it writes nothing."""

from __future__ import annotations

import sqlalchemy as sa

from service.rows import queues
from service.rows.clock import now
from service.rows.states import State
from service.rows.tables import jobs, workers


def living_workers(connection: sa.Connection, silence_seconds: float) -> int:
    """How many workers were heard of lately."""
    # The database's clock was set back: those heard of later than now may be dead for long.
    lately = workers.c.seen.between(now() - silence_seconds, now() + silence_seconds)
    count = sa.select(sa.func.count()).select_from(workers).where(lately)
    return connection.execute(count).scalar_one()


def jobs_by_state(connection: sa.Connection) -> dict[State, int]:
    """How many jobs are in each state."""
    found = connection.execute(sa.select(jobs.c.state, sa.func.count()).group_by(jobs.c.state))
    return dict.fromkeys(State, 0) | {State(state): count for state, count in found}


def longest_wait(connection: sa.Connection) -> float:
    """Seconds that the oldest job has waited for a worker; 0 when none waits.

    Jobs that wait for a camera, or for the moment that their pair is due, do not count. A job whose
    pair a camera took counts from when that capture began.
    """
    taken = sa.func.coalesce(jobs.c.started, jobs.c.created)
    since = sa.case((jobs.c.camera.is_(None), jobs.c.created), else_=taken)
    oldest = sa.select(now() - sa.func.min(since)).where(queues.waits_in_queue(None))
    return max(connection.execute(oldest).scalar_one() or 0.0, 0.0)
