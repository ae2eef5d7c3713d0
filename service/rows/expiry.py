"""The rows of jobs that are kept no longer."""

from __future__ import annotations

import sqlalchemy as sa

from service.rows import bursts
from service.rows.clock import moment, now
from service.rows.jobs import KEPT_FOR_SETUP
from service.rows.moves import move, update
from service.rows.states import State, before
from service.rows.tables import jobs


def limit_keeping(connection: sa.Connection, keep_seconds: float, limit: int) -> int:
    """Give ended jobs that were to be kept for ever a time at which they expire; how many got one.

    Up to `limit` at once, and no calibration that is kept for a set-up.
    """
    dateless, kept = jobs.c.expires.is_(None), (jobs.c.state == State.SUCCEEDED) & KEPT_FOR_SETUP
    endless = sa.and_(jobs.c.state.in_(before(State.EXPIRED)), dateless, ~kept)
    some = sa.select(jobs.c.id).where(endless).limit(limit)
    dated = update(jobs.c.id.in_(some)).values(expires=jobs.c.finished + keep_seconds)
    return connection.execute(dated).rowcount


def expire(connection: sa.Connection, limit: int) -> list[str]:
    """Up to `limit` jobs that are to be removed now, all of them in the state `expired`."""
    # In the order of an index: PostgreSQL guesses that many are due, and would read the table.
    first = sa.select(jobs.c.id).where(_due()).order_by(jobs.c.state, jobs.c.expires).limit(limit)
    found = connection.execute(first).scalars().all()
    if found:
        move(connection, State.EXPIRED, jobs.c.id.in_(found))
    # Those of a removal that was cut short are among them.
    expired = sa.select(jobs.c.id).where(jobs.c.state == State.EXPIRED).limit(limit)
    return list(connection.execute(expired).scalars())


def due(connection: sa.Connection) -> set[str]:
    """Ids of all jobs that are to be removed now, in the state `expired` or not yet."""
    found = sa.select(jobs.c.id).where(sa.or_(_due(), jobs.c.state == State.EXPIRED))
    return set(connection.execute(found).scalars())


def condemn(connection: sa.Connection, job_id: str) -> None:
    """Have a job expire now, or as soon as it has ended, so that it is removed in any case."""
    this = jobs.c.id == job_id
    connection.execute(update(this).values(expires=now()))
    move(connection, State.EXPIRED, this)


def remove(connection: sa.Connection, job_id: str) -> None:
    """Delete the row; a job of the same burst inherits its idempotency key."""
    this = sa.delete(jobs).where(jobs.c.id == job_id)
    key = connection.execute(this.returning(jobs.c.idempotency_key)).scalar()
    if key is not None:
        bursts.hand_on(connection, job_id, key)


def _due() -> sa.ColumnElement[bool]:
    # A webhook is told of an end first, unless the job was deleted before it came to that.
    told = sa.or_(
        jobs.c.webhook.is_(None),
        jobs.c.delivery["state"].as_string() != "pending",
        jobs.c.expires <= jobs.c.finished,
    )
    return sa.and_(jobs.c.state.in_(before(State.EXPIRED)), jobs.c.expires <= moment(), told)
