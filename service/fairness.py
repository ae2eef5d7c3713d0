"""Who goes next: self-clocked fair queueing of the jobs that wait.

The jobs of one owner and one priority are a flow. Flows that have jobs waiting go by turns, and
one of high priority more often; however many jobs wait in a flow, another's next one is soon.
"""

from __future__ import annotations

import sqlalchemy as sa

from service.database import jobs
from service.states import HELD, State

COST = {"high": 1, "normal": 4, "low": 16}
"""How far a job of a priority puts its flow back."""

MAX_RANK = 2**31 - 1
"""Where ranks end. They start again from nothing whenever no job waits or runs."""


def next_rank(connection: sa.Connection, owner: str, priority: str) -> int:
    """Rank of the next job of a flow, 1…MAX_RANK; jobs go in the order of their ranks.

    That is its cost after the job that was begun last, or after the last one of its flow that
    waits. Of jobs that come at once, two may get the same rank: they go in the order they came.
    """
    waiting = jobs.c.state == State.QUEUED
    begun = connection.execute(
        sa.select(sa.func.max(jobs.c.rank)).where(jobs.c.state.in_(HELD))
    ).scalar()
    head = connection.execute(
        sa.select(jobs.c.rank, jobs.c.priority).where(waiting).order_by(jobs.c.rank).limit(1)
    ).first()
    behind = connection.execute(
        sa.select(sa.func.max(jobs.c.rank)).where(
            waiting, jobs.c.owner == owner, jobs.c.priority == priority
        )
    ).scalar()
    # While no job is held, the head of the queue tells where the last one held must have been.
    clock = max(begun or 0, head.rank - COST[head.priority] if head else 0)
    return min(max(clock, behind or 0) + COST[priority], MAX_RANK)
