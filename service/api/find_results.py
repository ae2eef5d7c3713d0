"""Jobs that have results, as routes of results and mixes find them."""

from __future__ import annotations

from typing import Any

from service.api.callers import Caller, find
from service.api.context import Context
from service.errors import UnknownResultError
from service.rows import jobs
from service.rows.availability import check_succeeded


def find_succeeded(context: Context, caller: Caller, job_id: str) -> jobs.Job:
    """Find a job with results. Raises UnknownJobError, GoneError, NotReadyError, EndedError."""
    with context.engine.connect() as connection:
        job = find(connection, caller, job_id)
    check_succeeded(job)
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
