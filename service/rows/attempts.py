"""What workers write of their attempts into the rows of jobs, from the claim to the end.

Every write of an attempt names its number, so that an attempt that was taken over writes nothing.
"""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from service.rows.clock import now
from service.rows.jobs import Job, find
from service.rows.moves import NO_REQUEST, end, move, update
from service.rows.states import HELD, State
from service.rows.tables import jobs, workers

LOST_ATTEMPTS = 3
"""Attempts at a job that may be cut short before it is given up."""

_ANEW: dict[str, Any] = {
    "worker": None,
    "stage": None,
    "fraction": 0.0,
    "progress": 0.0,
    "eta": None,
}
"""What becomes of a job's progress when an attempt begins, or the job is put back."""


def claim(
    connection: sa.Connection, job_id: str, worker: str, stage: str | None = None
) -> Job | None:
    """Start the next attempt of a job, at a stage; None when it is not to be had (now).

    A job is to be had when it is queued, or when the worker that holds it is dead, which means
    that it has no row in `workers`; such an attempt counts as lost. So is one that this worker
    holds without knowing, because the answer to an earlier claim got lost on the way: a worker
    claims what it does not run. A job that was being canceled stays so: the caller ends it.
    """
    this = jobs.c.id == job_id
    attempt = _ANEW | {
        "attempt": jobs.c.attempt + 1,
        "worker": worker,
        "stage": stage,
        "started": sa.func.coalesce(jobs.c.started, now()),
    }
    asked = jobs.c.state == State.WAITING_FOR_OPERATOR
    if not move(connection, State.RUNNING, sa.and_(this, ~asked), **attempt):
        held, own = jobs.c.state.in_(HELD), jobs.c.worker == worker
        orphan = ~sa.exists().where(workers.c.id == jobs.c.worker)
        taken = connection.execute(
            update(sa.and_(this, held, sa.or_(own, orphan))).values(
                lost=jobs.c.lost + sa.case((own, 0), else_=1),
                state=sa.case((asked, State.RUNNING), else_=jobs.c.state),
                **NO_REQUEST,
                **attempt,
            )
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
    connection.execute(update(_of_attempt(job)).values(told))


def must_stop(connection: sa.Connection, job: Job) -> bool:
    """Whether the attempt is to stop: canceled, taken over, or its row is gone."""
    state = connection.execute(sa.select(jobs.c.state).where(_of_attempt(job))).scalar()
    return state not in (State.RUNNING, State.WAITING_FOR_OPERATOR)


def is_late(connection: sa.Connection, job: Job) -> bool:
    """Whether the job's deadline has passed."""
    late = sa.select(jobs.c.deadline < now()).where(jobs.c.id == job.id)
    return bool(connection.execute(late).scalar())


def set_inputs(
    connection: sa.Connection,
    job: Job,
    inputs: dict[str, Any],
    size: int,
    camera_settings: dict[str, Any] | None,
) -> bool:
    """Name the stored photographs of a capture, so that no later attempt takes them again.

    size: of both, in bytes. camera_settings: what the camera was set to. False when the attempt
    counts no more.
    """
    values = {"inputs": inputs, "stored_bytes": size, "camera_settings": camera_settings}
    return connection.execute(update(_of_attempt(job)).values(values)).rowcount == 1


def ask_operator(connection: sa.Connection, job: Job, request: str, seconds: float) -> None:
    """Ask whoever runs the camera for something, and wait for so many seconds."""
    asking = {"request": request, "requests": jobs.c.requests + 1, "request_until": now() + seconds}
    move(connection, State.WAITING_FOR_OPERATOR, _of_attempt(job), **asking)


def confirmed(connection: sa.Connection, job: Job) -> bool | None:
    """Whether what the attempt asked for is done; false when time is up, None while it waits."""
    asked = sa.and_(_of_attempt(job), jobs.c.state == State.WAITING_FOR_OPERATOR)
    if move(connection, State.RUNNING, sa.and_(asked, jobs.c.request_until < now())):
        return False
    state = connection.execute(sa.select(jobs.c.state).where(_of_attempt(job))).scalar()
    return True if state == State.RUNNING else None


def succeed(
    connection: sa.Connection,
    job: Job,
    results: list[dict[str, Any]],
    stage_seconds: dict[str, float] | None = None,
    keep_seconds: float | None = None,
) -> bool:
    """End the job with the files of this attempt; false when the attempt counts no more.

    stage_seconds: what each stage took.
    """
    done = {"results": results, "stage_seconds": stage_seconds, "fraction": 1.0, "progress": 1.0}
    stored = jobs.c.stored_bytes + sum(result["size"] for result in results)
    return end(
        connection,
        _of_attempt(job),
        State.SUCCEEDED,
        keep_seconds,
        stored_bytes=stored,
        **done,
    )


def fail(
    connection: sa.Connection,
    job: Job,
    error: dict[str, Any],
    keep_seconds: float | None = None,
) -> bool:
    """End the job with a problem; false when the attempt counts no more."""
    return end(connection, _of_attempt(job), State.FAILED, keep_seconds, error=error)


def acknowledge_cancel(
    connection: sa.Connection, job: Job, keep_seconds: float | None = None
) -> bool:
    """End a job that was asked to stop; false when it was not, or the attempt counts no more."""
    return end(connection, _of_attempt(job), State.CANCELED, keep_seconds)


def release(connection: sa.Connection, job: Job) -> bool:
    """Put the job back: a worker ends, or a pair was taken; the attempt does not count as lost.

    False when the attempt counts no more.
    """
    return move(connection, State.QUEUED, _of_attempt(job), **_ANEW)


def lose(connection: sa.Connection, job: Job) -> None:
    """Put back a job whose attempt was cut short though its worker lives."""
    move(connection, State.QUEUED, _of_attempt(job), lost=jobs.c.lost + 1, **_ANEW)
