"""Holds keys to their quotas, which the rows of jobs and of keys tell together."""

from __future__ import annotations

import sqlalchemy as sa

from pipeline.errors import counted
from service.errors import QuotaError, StoredQuotaError
from service.rows.clock import now
from service.rows.states import State
from service.rows.tables import jobs, keys, uploads

_DAY_SECONDS = 86400
_WAITING_RETRY_SECONDS = 10


def check(connection: sa.Connection, key_id: str, coming: int = 1) -> None:
    """Refuse another job of a key that has used up a quota, or several where they do not all fit.

    coming: how many; 0 where those that are there already have to fit. Raises QuotaError for jobs,
    StoredQuotaError for bytes. Of requests that come at once more may pass than there is room for:
    charge() refuses those.
    """
    key = connection.execute(sa.select(keys).where(keys.c.id == key_id)).first()
    if key is None:
        return
    if key.waiting_jobs is not None:
        waiting = _of_jobs(connection, key_id, sa.func.count(), jobs.c.state == State.QUEUED)
        if waiting + coming > key.waiting_jobs:
            has = "; send this one again when one has started"
            if coming > 1:
                has = f" {waiting}; ask for fewer than these {coming}, or wait till some have begun"
            raise QuotaError(
                f"This key may have {counted(key.waiting_jobs, 'job', 'jobs')} wait at a time, and "
                f"has{has}.",
                _WAITING_RETRY_SECONDS,
            )
    if key.jobs_per_day is not None:
        day, second = divmod(_now(connection), _DAY_SECONDS)
        made = key.jobs_of_day if key.day == day else 0
        if made + coming > key.jobs_per_day:
            has = f" made {made}; ask for fewer than these {coming}" if coming > 1 else ""
            raise QuotaError(
                f"This key may make {counted(key.jobs_per_day, 'job', 'jobs')} a day, and "
                f"has{has}; the next day begins at midnight UTC.",
                int(_DAY_SECONDS - second) + 1,
            )
    if key.stored_bytes is not None:
        _check_stored(connection, key_id, coming, key.stored_bytes)


def charge(connection: sa.Connection, key_id: str, count: int = 1) -> None:
    """Count jobs that were inserted in this transaction. Raises what check() raises."""
    day = int(_now(connection) // _DAY_SECONDS)
    so_far = sa.case((keys.c.day == day, keys.c.jobs_of_day), else_=0)
    # Locks the row until the end, so that jobs of the same key are counted one after the other.
    connection.execute(
        sa.update(keys).where(keys.c.id == key_id).values(day=day, jobs_of_day=so_far + count)
    )
    check(connection, key_id, coming=0)


def charge_upload(connection: sa.Connection, key_id: str) -> None:
    """Count an upload that was inserted in this transaction. Raises StoredQuotaError.

    Uploads count whole until a job takes them over or they expire, however little of them has come.
    """
    # Locked until the end, as by charge().
    query = sa.select(keys).where(keys.c.id == key_id).with_for_update()
    key = connection.execute(query).first()
    if key is not None and key.stored_bytes is not None:
        _check_stored(connection, key_id, 0, key.stored_bytes)


def _check_stored(connection: sa.Connection, key_id: str, coming: int, limit: int) -> None:
    # A job that comes has at least a byte, and may be made of uploads that are finished.
    begun = uploads.c.received < uploads.c.length if coming else sa.true()
    theirs = sa.and_(uploads.c.owner == key_id, uploads.c.expires > now())
    query = sa.select(sa.func.sum(uploads.c.length)).where(theirs, begun)
    stored = _of_jobs(connection, key_id, sa.func.sum(jobs.c.stored_bytes))
    if stored + int(connection.execute(query).scalar_one() or 0) + coming > limit:
        raise StoredQuotaError(
            f"This key's uploads and the photographs and results of its jobs may take {limit:,} "
            "bytes, and with this one they would take more; delete jobs or uploads first."
        )


def _of_jobs(
    connection: sa.Connection,
    key_id: str,
    figure: sa.ColumnElement[int],
    *which: sa.ColumnElement[bool],
) -> int:
    query = sa.select(figure).select_from(jobs).where(jobs.c.owner == key_id, *which)
    return int(connection.execute(query).scalar_one() or 0)


def _now(connection: sa.Connection) -> float:
    return connection.execute(sa.select(now())).scalar_one()
