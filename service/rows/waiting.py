"""Jobs that wait: how many, at which places, and which for too long."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable

import sqlalchemy as sa

from service.rows import queues
from service.rows.clock import moment
from service.rows.jobs import Job
from service.rows.states import State
from service.rows.tables import jobs

_ORDER = (jobs.c.rank, jobs.c.created, jobs.c.id)


def count_queued(connection: sa.Connection, owner: str | None = None) -> int:
    """How many jobs wait, of an owner or in all."""
    query = sa.select(sa.func.count()).select_from(jobs).where(jobs.c.state == State.QUEUED)
    if owner is not None:
        query = query.where(jobs.c.owner == owner)
    return connection.execute(query).scalar_one()


def positions(connection: sa.Connection, shown: Iterable[Job]) -> dict[str, int]:
    """Place in its queue, from 1, of every job of `shown` that waits, or did when it was read."""
    queued: dict[str | None, list[Job]] = {}
    for job in shown:
        if job.state == State.QUEUED:
            queued.setdefault(None if job.inputs else job.camera, []).append(job)
    places: dict[str, int] = {}
    for camera, those in queued.items():
        keys = {job.id: (job.rank, job.created, job.id) for job in those}
        if len(keys) == 1:  # as most clients ask, again and again: nothing of the others is read
            ((job_id, key),) = keys.items()
            waits, earlier = queues.waits_in_queue(camera), sa.tuple_(*_ORDER) < key
            count = sa.select(sa.func.count()).where(waits, earlier)
            places[job_id] = connection.execute(count).scalar_one() + 1
            continue
        ahead = sa.and_(queues.waits_in_queue(camera), sa.tuple_(*_ORDER) <= max(keys.values()))
        # as far as the last of them; one may have left since it was read, which has a place, too
        queue = sorted(map(tuple, connection.execute(sa.select(*_ORDER).where(ahead))))
        places |= {job_id: bisect_left(queue, key) + 1 for job_id, key in keys.items()}
    return places


def overdue(connection: sa.Connection, limit: int) -> list[tuple[str, str]]:
    """Up to `limit` jobs that wait past their deadlines, the first due first: ids and trace ids.

    They are this transaction's until it ends; those that another one holds are left out.
    """
    late = sa.and_(jobs.c.state == State.QUEUED, jobs.c.deadline < moment())
    # In the order of an index, else PostgreSQL guesses that many are late, and reads the table.
    first = sa.select(jobs.c.id, jobs.c.trace_id).where(late).order_by(jobs.c.deadline)
    held = first.limit(limit).with_for_update(skip_locked=True)
    return [(job_id, trace_id) for job_id, trace_id in connection.execute(held)]
