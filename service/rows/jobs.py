"""The rows of jobs: the only truth about a job's state.

Every change of state but a takeover's is one of service.rows.moves. What workers write of their
attempts is in service.rows.attempts.
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
from service.rows.clock import now
from service.rows.database import may_be_id, once_committed
from service.rows.moves import end, move
from service.rows.states import ENDED, HELD, State
from service.rows.tables import CALIBRATES, jobs

Priority = Literal["high", "normal", "low"]

PAGE_CHARACTERS = 4 * 1024 * 1024
"""Of JSON: the options of the jobs of a page, of which those of one may take a MiB."""


@dataclass(frozen=True)
class Job:
    """One row of service.rows.tables; times are seconds since 1970 by the database's clock."""

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


def confirm(connection: sa.Connection, job_id: str, number: int | None = None) -> bool:
    """Say that what was asked for is done; false when the job does not ask (for that any more).

    number: of the request, so that a second click does not answer the next one.
    """
    asked = sa.and_(jobs.c.id == job_id, jobs.c.state == State.WAITING_FOR_OPERATOR)
    if number is not None:
        asked = sa.and_(asked, jobs.c.requests == number)
    return move(connection, State.RUNNING, asked)
