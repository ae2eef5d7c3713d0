"""Who sends a request."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import sqlalchemy as sa
from fastapi import Depends

from service import jobs
from service.errors import UnknownJobError


@dataclass(frozen=True)
class Caller:
    """Who sends a request; owner: id of the key, "" where the service asks for none."""

    owner: str


def _identify() -> Caller:
    return Caller("")


Calling = Annotated[Caller, Depends(_identify)]


def find(connection: sa.Connection, caller: Caller, job_id: str) -> jobs.Job:
    """Find a job of the caller's. Raises UnknownJobError, also for those of others."""
    job = jobs.find(connection, job_id)
    if job is None or job.owner != caller.owner:
        raise UnknownJobError(f"There is no job {job_id[:32]!r}; it may have been deleted.")
    return job
