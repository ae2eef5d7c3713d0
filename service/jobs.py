"""The rows of jobs: the only truth about a job's state.

Every change of state goes through the table in service.states, as one compare-and-set. Every write
of an attempt names its number, so that an attempt that was taken over writes nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import sqlalchemy as sa

from service import metrics, quotas
from service.database import jobs, now, workers
from service.states import ENDED, HELD, State, before

Priority = Literal["high", "normal", "low"]

LOST_ATTEMPTS = 3
"""Attempts a job may lose with their workers before it is given up."""


@dataclass(frozen=True)
class Job:
    """One row; times are seconds since 1970 by the database's clock. Columns: service.database."""

    id: str
    revision: int
    owner: str
    state: State
    priority: Priority
    rank: int
    stage: str | None
    fraction: float
    progress: float
    eta: float | None
    likeness: str
    stage_seconds: dict[str, float] | None
    attempt: int
    lost: int
    worker: str | None
    options: dict[str, Any]
    capture: dict[str, Any] | None
    inputs: dict[str, Any] | None
    results: list[dict[str, Any]] | None
    error: dict[str, Any] | None
    trace_id: str
    span_id: str | None
    webhook: dict[str, Any] | None
    delivery: dict[str, Any] | None
    idempotency_key: str | None
    request_hash: str
    created: float
    started: float | None
    finished: float | None
    deadline: float | None
    expires: float | None
    stored_bytes: int

    @property
    def task(self) -> Literal["separate", "calibrate", "mix"]:
        """What a worker is to do: the options of a mix and of a calibration name their kind."""
        kind = self.options.get("kind")
        if kind == "mix":
            return "mix"
        return "calibrate" if kind else "separate"

    @property
    def ended(self) -> bool:
        """Whether nothing will happen to the job any more."""
        return self.state in ENDED


def _job(row: sa.Row[Any]) -> Job:
    return Job(**{**row._mapping, "state": State(row.state)})


def add(connection: sa.Connection, values: Mapping[str, Any]) -> None:
    """Insert a queued job and charge its owner for it.

    Raises sqlalchemy.exc.IntegrityError on a used idempotency key, and what quotas.charge raises.
    """
    connection.execute(sa.insert(jobs).values(state=State.QUEUED, created=now(), **values))
    quotas.charge(connection, values.get("owner", ""))
    metrics.ACCEPTED.inc()


def find(connection: sa.Connection, job_id: str) -> Job | None:
    """Find the job of this id."""
    row = connection.execute(sa.select(jobs).where(jobs.c.id == job_id)).first()
    return _job(row) if row else None


def find_all(connection: sa.Connection, job_ids: Collection[str]) -> list[Job]:
    """Find the jobs of these ids that there are."""
    return [_job(row) for row in connection.execute(sa.select(jobs).where(jobs.c.id.in_(job_ids)))]


def find_by_key(connection: sa.Connection, owner: str, idempotency_key: str) -> Job | None:
    """Find the job that an owner made under this idempotency key."""
    row = connection.execute(
        sa.select(jobs).where(jobs.c.owner == owner, jobs.c.idempotency_key == idempotency_key)
    ).first()
    return _job(row) if row else None


def page(connection: sa.Connection, owner: str | None, limit: int, after: Job | None) -> list[Job]:
    """Up to `limit` jobs of an owner, or of all for None, newest first, older than `after`."""
    query = sa.select(jobs)
    if owner is not None:
        query = query.where(jobs.c.owner == owner)
    query = query.order_by(jobs.c.created.desc(), jobs.c.id.desc()).limit(limit)
    if after:
        query = query.where(sa.tuple_(jobs.c.created, jobs.c.id) < (after.created, after.id))
    return [_job(row) for row in connection.execute(query)]


def newest(connection: sa.Connection, state: State | None, limit: int) -> list[Job]:
    """Up to `limit` jobs of all owners, newest first; state: those in it only."""
    query = sa.select(jobs).order_by(jobs.c.created.desc(), jobs.c.id.desc()).limit(limit)
    if state:
        query = query.where(jobs.c.state == state)
    return [_job(row) for row in connection.execute(query)]


def count_queued(connection: sa.Connection) -> int:
    """How many jobs wait."""
    query = sa.select(sa.func.count()).select_from(jobs).where(jobs.c.state == State.QUEUED)
    return connection.execute(query).scalar_one()


def positions(connection: sa.Connection, waiting: list[Job]) -> dict[str, int]:
    """Place in the queue, from 1, of every job of `waiting` that is queued."""
    queued = [job for job in waiting if job.state == State.QUEUED]
    return {
        job.id: connection.execute(
            sa.select(sa.func.count())
            .select_from(jobs)
            .where(
                jobs.c.state == State.QUEUED,
                sa.tuple_(jobs.c.created, jobs.c.id) <= (job.created, job.id),
            )
        ).scalar_one()
        for job in queued
    }


def request_cancel(connection: sa.Connection, job_id: str) -> None:
    """Cancel a queued job at once and ask the worker of a running one to stop."""
    this = jobs.c.id == job_id
    # Else a job that is claimed or put back between the two moves would slip through.
    connection.execute(sa.select(jobs.c.id).where(this).with_for_update())
    _move(connection, State.CANCELED, sa.and_(this, jobs.c.worker.is_(None)), finished=now())
    _move(connection, State.CANCELING, this)


def remove(connection: sa.Connection, job_id: str) -> None:
    """Delete the row."""
    connection.execute(sa.delete(jobs).where(jobs.c.id == job_id))


def beat(connection: sa.Connection, worker: str) -> None:
    """Say that a worker lives."""
    seen = connection.execute(sa.update(workers).where(workers.c.id == worker).values(seen=now()))
    if seen.rowcount == 0:
        connection.execute(sa.insert(workers).values(id=worker, seen=now()))


def leave(connection: sa.Connection, worker: str) -> None:
    """Say that a worker ends; what it still holds may be taken over at once."""
    connection.execute(sa.delete(workers).where(workers.c.id == worker))


def living_workers(connection: sa.Connection, silence_seconds: float) -> set[str]:
    """Workers heard of lately. Forgets the others."""
    connection.execute(sa.delete(workers).where(workers.c.seen < now() - silence_seconds))
    return set(connection.execute(sa.select(workers.c.id)).scalars())


def claim(connection: sa.Connection, job_id: str, worker: str) -> Job | None:
    """Start the next attempt of a job; None when it is not to be had (now).

    A job is to be had when it is queued, or when the worker that holds it is dead, which means
    that it has no row in `workers`; such an attempt counts as lost. A job that was being canceled
    stays so: the caller ends it.
    """
    this = jobs.c.id == job_id
    attempt = {
        "attempt": jobs.c.attempt + 1,
        "worker": worker,
        "stage": None,
        "fraction": 0.0,
        "progress": 0.0,
        "eta": None,
        "started": sa.func.coalesce(jobs.c.started, now()),
    }
    if not _move(connection, State.RUNNING, this, **attempt):
        orphan = sa.and_(jobs.c.state.in_(HELD), ~sa.exists().where(workers.c.id == jobs.c.worker))
        taken = connection.execute(
            _update(sa.and_(this, orphan)).values(lost=jobs.c.lost + 1, **attempt)
        )
        if not taken.rowcount:
            return None
    return find(connection, job_id)


def _of_attempt(job: Job) -> sa.ColumnElement[bool]:
    return sa.and_(
        jobs.c.id == job.id,
        jobs.c.attempt == job.attempt,
        jobs.c.state.in_(HELD),
    )


def report(
    connection: sa.Connection,
    job: Job,
    stage: str,
    fraction: float,
    progress: float = 0.0,
    seconds_left: float | None = None,
) -> None:
    """Write how far the attempt is: `fraction` (0…1) of `stage`, `progress` (0…1) of the whole."""
    eta = None if seconds_left is None else now() + seconds_left
    told = {"stage": stage, "fraction": fraction, "progress": progress, "eta": eta}
    connection.execute(_update(_of_attempt(job)).values(told))


def must_stop(connection: sa.Connection, job: Job) -> bool:
    """Whether the attempt is to stop: canceled, taken over, or its row is gone."""
    state = connection.execute(sa.select(jobs.c.state).where(_of_attempt(job))).scalar()
    return state != State.RUNNING


def set_inputs(connection: sa.Connection, job: Job, inputs: dict[str, Any], size: int) -> None:
    """Name the stored photographs of a capture, so that no later attempt takes them again.

    size: of both, in bytes.
    """
    connection.execute(_update(_of_attempt(job)).values(inputs=inputs, stored_bytes=size))


def succeed(
    connection: sa.Connection,
    job: Job,
    results: list[dict[str, Any]],
    stage_seconds: dict[str, float] | None = None,
) -> bool:
    """End the job with the files of this attempt; false when the attempt counts no more.

    stage_seconds: what each stage took.
    """
    done = {"results": results, "stage_seconds": stage_seconds, "fraction": 1.0, "progress": 1.0}
    stored = jobs.c.stored_bytes + sum(result["size"] for result in results)
    return _end(connection, job, State.SUCCEEDED, stored_bytes=stored, **done)


def fail(connection: sa.Connection, job: Job, error: dict[str, Any]) -> bool:
    """End the job with a problem; false when the attempt counts no more."""
    return _end(connection, job, State.FAILED, error=error)


def acknowledge_cancel(connection: sa.Connection, job: Job) -> bool:
    """End a job that was asked to stop; false when it was not, or the attempt counts no more."""
    return _end(connection, job, State.CANCELED)


def release(connection: sa.Connection, job: Job) -> None:
    """Put the job back, for a worker that ends; the attempt does not count as lost."""
    fresh = {"worker": None, "stage": None, "fraction": 0.0, "progress": 0.0, "eta": None}
    _move(connection, State.QUEUED, _of_attempt(job), **fresh)


def set_delivery(connection: sa.Connection, job_id: str, delivery: dict[str, Any]) -> None:
    """Write what came of telling the job's webhook."""
    connection.execute(_update(jobs.c.id == job_id).values(delivery=delivery))


def with_news(connection: sa.Connection, limit: int) -> list[Job]:
    """Ended jobs with a webhook for which no delivery is queued yet, up to `limit`."""
    # Spelt as the index has it, so that it is used; the rows are held until the transaction ends.
    news = sa.and_(jobs.c.webhook.is_not(None), jobs.c.delivery.is_(None), jobs.c.state.in_(ENDED))
    query = sa.select(jobs).where(news).limit(limit).with_for_update(skip_locked=True)
    return [_job(row) for row in connection.execute(query)]


def _end(connection: sa.Connection, job: Job, state: State, **values: Any) -> bool:
    ended = {"worker": None, "eta": None, "finished": now()}
    return _move(connection, state, _of_attempt(job), **ended, **values)


def _move(
    connection: sa.Connection, state: State, which: sa.ColumnElement[bool], **values: Any
) -> bool:
    moved = connection.execute(
        _update(sa.and_(which, jobs.c.state.in_(before(state)))).values(state=state, **values)
    )
    if state in ENDED:
        metrics.FINISHED.labels(state.value).inc(moved.rowcount)
    return moved.rowcount == 1


def _update(which: sa.ColumnElement[bool]) -> sa.Update:
    return sa.update(jobs).where(which).values(revision=jobs.c.revision + 1)
