"""What is done to jobs that go on, over HTTP and on the command line alike."""

from __future__ import annotations

import sqlalchemy as sa

from service.dbos_queue.queue import Queue
from service.errors import EndedError, NotReadyError
from service.rows import jobs
from service.rows.states import State
from service.settings import Settings


def cancel(engine: sa.Engine, queue: Queue, settings: Settings, job_id: str) -> None:
    """Stop a job; one that has ended, or is not there, stays as it is."""
    with engine.begin() as connection:
        jobs.request_cancel(connection, job_id, settings.retention_seconds)
        job = jobs.find(connection, job_id)
    if job and job.state == State.CANCELED:
        queue.withdraw(job_id)


def confirm(connection: sa.Connection, job: jobs.Job, request: int | None = None) -> None:
    """Say that what a job asks its operator for is done.

    job: as it is in this transaction. request: number of the one that is done, from 1; None: any.
    Raises EndedError and NotReadyError where it asks for nothing, or for something else.
    """
    if job.ended:
        raise EndedError(f"The job is {job.state}; it asks for nothing any more.")
    if not jobs.confirm(connection, job.id, request):
        raise NotReadyError(
            f"The job is {job.state}; it waits for something else."
            if job.request
            else f"The job is {job.state}; it asks for nothing."
        )
