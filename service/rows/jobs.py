"""The rows of jobs: the only truth about a job's state.

Every change of state but a takeover's is one of service.rows.moves. Every write of an attempt names
its number, so that an attempt that was taken over writes nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from typing import Any, Literal

import sqlalchemy as sa

from service import counters
from service.frames import FRAMES
from service.object_keys import captured_key
from service.rows import fairness, queues, quotas
from service.rows.database import CALIBRATES, jobs, may_be_id, now, once_committed, workers
from service.rows.moves import NO_REQUEST, end, move, update
from service.rows.states import ENDED, HELD, State

Priority = Literal["high", "normal", "low"]

LOST_ATTEMPTS = 3
"""Attempts at a job that may be cut short before it is given up."""

PAGE_CHARACTERS = 4 * 1024 * 1024
"""Of JSON: the options of the jobs of a page, of which those of one may take a MiB."""


@dataclass(frozen=True)
class Job:
    """One row of service.rows.database; times are seconds since 1970 by the database's clock."""

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
    camera: str | None
    camera_settings: dict[str, Any] | None
    inputs: dict[str, Any] | None
    results: list[dict[str, Any]] | None
    error: dict[str, Any] | None
    trace_id: str
    span_id: str | None
    request: str | None
    requests: int
    request_until: float | None
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

    @property
    def captures(self) -> bool:
        """Whether a worker has the job's camera take the pair, or is about to pass it on."""
        return self.state in HELD and self.stage == queues.CAPTURE

    def has_pair_of(self, attempt: int) -> bool:
        """Whether the pair of the job is one that an attempt had a camera take."""
        return self.inputs is not None and any(
            self.inputs[frame]["key"] == captured_key(self.id, attempt, frame) for frame in FRAMES
        )


KEPT_FOR_SETUP = sa.and_(CALIBRATES, jobs.c.options["setup"].as_string().is_not(None))
"""Whether a job is a calibration that is kept for a set-up."""


def _job(row: sa.Row[Any]) -> Job:
    return Job(**{**row._mapping, "state": State(row.state)})


def add(
    connection: sa.Connection, values: Mapping[str, Any], deadline_seconds: float | None = None
) -> int:
    """Insert a queued job and charge its owner for it; its rank. deadline_seconds: from now.

    Raises sqlalchemy.exc.IntegrityError on a used idempotency key, and what quotas.charge raises.
    """
    return add_burst(connection, [(values, deadline_seconds)])[0]


def add_burst(
    connection: sa.Connection, burst: Sequence[tuple[Mapping[str, Any], float | None]]
) -> list[int]:
    """Insert queued jobs of one owner, one or more, and charge it once for all; their ranks.

    burst: values and deadline_seconds of each, as for add, which raises the same.
    """
    ranks = [_insert(connection, values, seconds) for values, seconds in burst]
    quotas.charge(connection, burst[0][0].get("owner", ""), len(burst))
    once_committed(connection, partial(counters.ACCEPTED.inc, len(burst)))
    return ranks


def _insert(
    connection: sa.Connection, values: Mapping[str, Any], deadline_seconds: float | None
) -> int:
    owner, priority = values.get("owner", ""), values.get("priority", "normal")
    rank = fairness.next_rank(connection, owner, priority, values.get("camera"))
    deadline = None if deadline_seconds is None else now() + deadline_seconds
    row = sa.insert(jobs).values(state=State.QUEUED, rank=rank, created=now(), deadline=deadline)
    connection.execute(row.values(**values))
    return rank


def find(connection: sa.Connection, job_id: str) -> Job | None:
    """Find the job of this id, which may be any text."""
    if not may_be_id(job_id):
        return None
    row = connection.execute(sa.select(jobs).where(jobs.c.id == job_id)).first()
    return _job(row) if row else None


def find_all(connection: sa.Connection, job_ids: Collection[str]) -> list[Job]:
    """Find the jobs of these ids that there are."""
    return [_job(row) for row in connection.execute(sa.select(jobs).where(jobs.c.id.in_(job_ids)))]


def find_by_key(connection: sa.Connection, owner: str, idempotency_key: str) -> Job | None:
    """Find the job that an owner made under this idempotency key."""
    this = sa.and_(jobs.c.owner == owner, jobs.c.idempotency_key == idempotency_key)
    row = connection.execute(sa.select(jobs).where(this)).first()
    return _job(row) if row else None


def page(
    connection: sa.Connection,
    owner: str | None,
    limit: int,
    after: tuple[float, str] | None = None,
    state: State | None = None,
) -> list[Job]:
    """Up to `limit` jobs of an owner, or of all for None, newest first.

    after: `created` and id of a job that may be gone; those that are older. state: those in it
    only.
    """
    query = _paged(sa.select(jobs), owner, limit, after)
    if state:
        query = query.where(jobs.c.state == state)
    return [_job(row) for row in connection.execute(query)]


def count_fitting(
    connection: sa.Connection, owner: str | None, limit: int, after: tuple[float, str] | None
) -> int:
    """How many jobs of such a page have options of PAGE_CHARACTERS together; 1 at least."""
    length = sa.func.length(sa.cast(jobs.c.options, sa.Text))
    query = _paged(sa.select(length), owner, limit, after)
    lengths: list[int] = list(connection.execute(query).scalars())
    return max(1, sum(upto <= PAGE_CHARACTERS for upto in accumulate(lengths)))


def _paged(
    query: sa.Select[Any], owner: str | None, limit: int, after: tuple[float, str] | None
) -> sa.Select[Any]:
    if owner is not None:
        query = query.where(jobs.c.owner == owner)
    query = query.order_by(jobs.c.created.desc(), jobs.c.id.desc()).limit(limit)
    if after:
        query = query.where(sa.tuple_(jobs.c.created, jobs.c.id) < after)
    return query


def kept_calibrations(connection: sa.Connection, owner: str, setup: str | None) -> list[Job]:
    """Calibrations of an owner that are kept for a set-up, or for any, newest first."""
    named = sa.true() if setup is None else jobs.c.options["setup"].as_string() == setup
    own = sa.and_(jobs.c.owner == owner, jobs.c.state == State.SUCCEEDED, named, KEPT_FOR_SETUP)
    rows = connection.execute(sa.select(jobs).where(own).order_by(jobs.c.created.desc()))
    return [_job(row) for row in rows]


def request_cancel(
    connection: sa.Connection, job_id: str, keep_seconds: float | None = None
) -> None:
    """Cancel a queued job at once and ask the worker of a running one to stop.

    keep_seconds: how long a job that has ended is kept, here as everywhere; None: for ever.
    """
    this = jobs.c.id == job_id
    # Else a job that is claimed or put back between the two moves would slip through.
    connection.execute(sa.select(jobs.c.id).where(this).with_for_update())
    end(connection, sa.and_(this, jobs.c.worker.is_(None)), State.CANCELED, keep_seconds)
    move(connection, State.CANCELING, this)


def fail_waiting(
    connection: sa.Connection,
    job_id: str,
    error: dict[str, Any],
    keep_seconds: float | None = None,
) -> bool:
    """End a queued job with a problem; false when it waits no more."""
    waits = sa.and_(jobs.c.id == job_id, jobs.c.state == State.QUEUED)
    return end(connection, waits, State.FAILED, keep_seconds, error=error)


def known(connection: sa.Connection, job_ids: Sequence[str]) -> set[str]:
    """Those of these ids that are ids of jobs."""
    found = sa.select(jobs.c.id).where(jobs.c.id.in_(job_ids))
    return set(connection.execute(found).scalars())


def held(connection: sa.Connection, job_ids: Collection[str]) -> set[str]:
    """Those of these jobs that workers have in hand, as their rows say: none that was put back."""
    if not job_ids:  # as at most heartbeats
        return set()
    found = sa.select(jobs.c.id).where(jobs.c.id.in_(job_ids), jobs.c.state.in_(HELD))
    return set(connection.execute(found).scalars())


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
    attempt = {
        "attempt": jobs.c.attempt + 1,
        "worker": worker,
        "stage": stage,
        "fraction": 0.0,
        "progress": 0.0,
        "eta": None,
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


def confirm(connection: sa.Connection, job_id: str, number: int | None = None) -> bool:
    """Say that what was asked for is done; false when the job does not ask (for that any more).

    number: of the request, so that a second click does not answer the next one.
    """
    asked = sa.and_(jobs.c.id == job_id, jobs.c.state == State.WAITING_FOR_OPERATOR)
    if number is not None:
        asked = sa.and_(asked, jobs.c.requests == number)
    return move(connection, State.RUNNING, asked)


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
    return move(connection, State.QUEUED, _of_attempt(job), **_WAITS_ANEW)


def lose(connection: sa.Connection, job: Job) -> None:
    """Put back a job whose attempt was cut short though its worker lives."""
    move(connection, State.QUEUED, _of_attempt(job), lost=jobs.c.lost + 1, **_WAITS_ANEW)


_WAITS_ANEW: dict[str, float | None] = {
    "worker": None,
    "stage": None,
    "fraction": 0.0,
    "progress": 0.0,
    "eta": None,
}
"""What becomes of a job's progress when it is put back."""
