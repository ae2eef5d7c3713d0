"""Bursts: jobs of one request, whose ids differ in their last digits only.

One job of them bears the request's idempotency key; when it is removed, another one inherits it.
"""

from __future__ import annotations

import uuid

import sqlalchemy as sa

from service.rows.tables import jobs

_DIGITS = 3  # hexadecimal: 4096 ids


def new_ids(count: int) -> list[str]:
    """Make ids for the jobs of a burst of up to 4096, in order."""
    shared = uuid.uuid4().hex[:-_DIGITS]
    return [f"{shared}{number:0{_DIGITS}x}" for number in range(count)]


def kept(connection: sa.Connection, job_id: str) -> list[str]:
    """Ids of the jobs of a job's burst that are not removed, in order."""
    return list(connection.execute(_burst(job_id)).scalars())


def hand_on(connection: sa.Connection, job_id: str, idempotency_key: str) -> None:
    """Give the key of a job that is removed to the next one of its burst, if there is one."""
    # Held until the transaction ends, else both might be removed at once, and the key be lost.
    heir = connection.execute(_burst(job_id).limit(1).with_for_update()).scalar()
    if heir is not None:
        this = sa.update(jobs).where(jobs.c.id == heir)
        connection.execute(this.values(idempotency_key=idempotency_key))


def _burst(job_id: str) -> sa.Select[str]:
    shared = job_id[:-_DIGITS]
    burst = jobs.c.id.between(shared + "0" * _DIGITS, shared + "f" * _DIGITS)
    return sa.select(jobs.c.id).where(burst).order_by(jobs.c.id)
