"""Whether a job's results can be had: they are not there yet, never will be, or are removed."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from service.errors import EndedError, GoneError, NotReadyError
from service.rows import jobs
from service.rows.states import State


def check_succeeded(job: jobs.Job) -> None:
    """Refuse a job without results. Raises GoneError, NotReadyError, EndedError."""
    if job.state == State.EXPIRED:
        raise GoneError("The job's results and photographs are removed; send the pair again.")
    if job.state == State.FAILED:
        raise EndedError("The job is failed; its `error` says why, and there will be no results.")
    if job.state == State.CANCELED:
        raise EndedError("The job is canceled; there will be no results, so run it again.")
    if job.state != State.SUCCEEDED:
        raise NotReadyError(f"The job is {job.state}; results are there once it is succeeded.")


@contextlib.contextmanager
def deleted_meanwhile() -> Iterator[None]:
    """Raise GoneError for a file that its job's row still names, and that is not there."""
    try:
        yield
    except FileNotFoundError as error:
        raise GoneError("The job is being deleted; its results are gone.") from error
