"""Rows of jobs as tests make and hold them."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from service.rows import attempts, heartbeats, jobs
from tests.unit.service.asking import stored


def added(engine: sa.Engine, job_id: str, **values: Any) -> jobs.Job:
    """A queued job."""
    row = {"options": {}, "trace_id": "t", "request_hash": "h", **values}
    with engine.begin() as connection:
        jobs.add(connection, {"id": job_id, **row})
    return stored(engine, job_id)


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
