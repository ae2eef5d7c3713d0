"""Jobs that have results, as routes of results and mixes find them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from service import jobs
from service.api.callers import Caller, find
from service.api.context import Context
from service.errors import EndedError, GoneError, NotReadyError, UnknownResultError
from service.states import State


def find_succeeded(context: Context, caller: Caller, job_id: str) -> jobs.Job:
    """Find a job with results. Raises UnknownJobError, GoneError, NotReadyError, EndedError."""
    with context.engine.connect() as connection:
        job = find(connection, caller, job_id)
    if job.state == State.EXPIRED:
        raise GoneError("The results of the job are removed; run it again.")
    if job.ended and job.state != State.SUCCEEDED:
        raise EndedError(f"The job is {job.state}; there will be no results, so run it again.")
    if job.state != State.SUCCEEDED:
        raise NotReadyError(f"The job is {job.state}; results are there once it is succeeded.")
    return job


def find_result(job: jobs.Job, name: str) -> dict[str, Any]:
    """Find a file among the job's results. Raises UnknownResultError."""
    # Only names that the job wrote are ever looked up, so that no name can leave its folder.
    for result in job.results or []:
        if result["name"] == name:
            return result
    raise UnknownResultError(
        "The job has no result of this name; its `files` lists those that it has."
    )


@contextlib.contextmanager
def deleted_meanwhile() -> Iterator[None]:
    """Raise GoneError for a file that its job's row still names, and that is not there."""
    try:
        yield
    except FileNotFoundError as error:
        raise GoneError("The job is being deleted; its results are gone.") from error
