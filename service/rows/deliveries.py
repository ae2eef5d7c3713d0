"""Deliveries of ends of jobs to their webhooks, one column of the jobs' rows.

Every write is one compare-and-set: of two workers that deliver to the same webhook, the slower one
takes nothing back.
"""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from service.rows.states import State
from service.rows.tables import jobs


def due(connection: sa.Connection, limit: int) -> list[str]:
    """Ended jobs with a webhook for which no delivery is queued yet, up to `limit`.

    Without those that were deleted, before their end or after it, and whose removal goes on.
    """
    # Spelt as the index has it, so that it is used; the rows are held until the transaction ends.
    unbegun = sa.and_(jobs.c.webhook.is_not(None), jobs.c.delivery.is_(None), jobs.c.finished > 0)
    # A job whose time is over does not expire undelivered, so one that has expired was deleted.
    deleted_before = sa.and_(jobs.c.expires.is_not(None), jobs.c.expires <= jobs.c.finished)
    kept = sa.and_(jobs.c.state != State.EXPIRED, ~deleted_before)
    query = sa.select(jobs.c.id).where(unbegun, kept).limit(limit).with_for_update(skip_locked=True)
    return list(connection.execute(query).scalars())


def write(connection: sa.Connection, job_id: str, delivery: dict[str, Any]) -> bool:
    """Write how far a job's delivery is; false when it was as far or further already."""
    earlier = jobs.c.delivery
    pending = earlier["state"].as_string() == "pending"
    fewer = earlier["attempts"].as_integer() < delivery["attempts"]
    behind = sa.or_(earlier.is_(None), sa.and_(pending, fewer))
    values = {"delivery": delivery, "revision": jobs.c.revision + 1}
    this = sa.update(jobs).where(jobs.c.id == job_id, behind)
    return connection.execute(this.values(values)).rowcount == 1
