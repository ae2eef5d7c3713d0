"""Rows of jobs as tests make and hold them."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from service.frames import FRAMES
from service.object_keys import describe_inputs
from service.rows import attempts, expiry, heartbeats, jobs
from service.rows.states import State
from tests.unit.service.asking import stored


def added(engine: sa.Engine, job_id: str, **values: Any) -> jobs.Job:
    """A queued job."""
    row = {"options": {}, "trace_id": "t", "request_hash": "h", **values}
    with engine.begin() as connection:
        jobs.add(connection, {"id": job_id, **row})
    return stored(engine, job_id)


def added_pair(engine: sa.Engine, **values: Any) -> None:
    """Add the job "a" of two photographs, queued."""
    inputs = describe_inputs("a", dict.fromkeys(FRAMES, ""))
    added(engine, "a", **{"inputs": inputs, "trace_id": "1" * 32, **values})


def claim(engine: sa.Engine, job_id: str, worker: str) -> jobs.Job | None:
    """What a worker gets that asks for a job."""
    with engine.begin() as connection:
        return attempts.claim(connection, job_id, worker)


def claimed(engine: sa.Engine, job_id: str, worker: str) -> jobs.Job:
    """A job in the hands of a worker that lives."""
    with engine.begin() as connection:
        heartbeats.beat(connection, worker)
    job = claim(engine, job_id, worker)
    assert job is not None
    return job


def in_state(engine: sa.Engine, state: State) -> jobs.Job:
    """Bring a job to a state; the attempt that worked on it last."""
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        if state == State.QUEUED:
            attempts.release(connection, held)
        if state == State.WAITING_FOR_OPERATOR:
            ask(connection, held)
        if state in (State.CANCELING, State.CANCELED):
            jobs.request_cancel(connection, "a")
        if state == State.CANCELED:
            attempts.acknowledge_cancel(connection, held)
        if state == State.SUCCEEDED:
            attempts.succeed(connection, held, [])
        if state == State.FAILED:
            attempts.fail(connection, held, {})
        if state == State.EXPIRED:
            attempts.succeed(connection, held, [])
            expiry.condemn(connection, "a")
    assert stored(engine, "a").state == state
    return held


def ask(connection: sa.Connection, held: jobs.Job) -> None:
    attempts.ask_operator(connection, held, "Switch the flash off.", 60)
