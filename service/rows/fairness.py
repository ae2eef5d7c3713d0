"""Who goes next: self-clocked fair queueing of the jobs that wait.

The jobs of one owner and one priority are a flow. Flows that have jobs waiting go by turns, and
one of high priority more often; however many jobs wait in a flow, another's next one is soon.
"""

from __future__ import annotations

import sqlalchemy as sa

from service.rows import queues
from service.rows.tables import jobs

COST = {"high": 1, "normal": 4, "low": 16}
"""How far a job of a priority puts its flow back."""

MAX_RANK = 2**31 - 1
"""Where ranks end. They start again from nothing whenever no job waits or runs."""


def next_rank(
    connection: sa.Connection, owner: str, priority: str, camera: str | None = None
) -> int:
    """Rank of the next job of a flow, 1…MAX_RANK; jobs go in the order of their ranks.

    That is its cost after the job that was begun last, or after the last one of its flow that
    waits for the same, the workers or a camera. Of jobs that come at once, two may get the same
    rank: they go in the order they came.
    camera: the one that the job waits for first; what other cameras do, nobody else waits for.
    """
    clock = _clock(connection, None)
    if camera is not None:
        clock = max(clock, _clock(connection, camera))
    behind = connection.execute(
        sa.select(sa.func.max(jobs.c.rank)).where(
            queues.waits_in_queue(camera), jobs.c.owner == owner, jobs.c.priority == priority
        )
    ).scalar()
    return min(max(clock, behind or 0) + COST[priority], MAX_RANK)


def _clock(connection: sa.Connection, camera: str | None) -> int:
    """How far the queue of a camera is; None: that of the workers."""
    begun = connection.execute(
        sa.select(sa.func.max(jobs.c.rank)).where(queues.is_held_from_queue(camera))
    ).scalar()
    waiting = sa.select(jobs.c.rank, jobs.c.priority).where(queues.waits_in_queue(camera))
    head = connection.execute(waiting.order_by(jobs.c.rank).limit(1)).first()
    # While no job is held, the head of the queue tells where the last one held must have been.
    return max(begun or 0, head.rank - COST[head.priority] if head else 0)
