"""Routes of jobs: make, list, watch, cancel, delete."""

from __future__ import annotations

import asyncio
import re
import time
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

import drivers
from pipeline.options import Options
from service import jobs
from service.api import intake
from service.api.accept import accept, refuse_when_full
from service.api.calibrated import fill_in
from service.api.callers import Caller, Calling, find
from service.api.context import Context, Parts, TraceId
from service.api.models import CaptureRequest, Handling, JobAnswer, JobPage
from service.api.problems import responses
from service.api.uploads import IdempotencyKey, accepted, pair_form
from service.errors import UnknownJobError
from service.retention import remove
from service.states import State

router = APIRouter(tags=["jobs"])

WAIT_SECONDS = 60
"""The longest that `Prefer: wait=N` waits."""

_LOOK_SECONDS = 0.2

_BODY = {
    "required": True,
    "content": {
        **pair_form({"$ref": "#/components/schemas/Options"}, "Options as JSON text."),
        "application/json": {"schema": {"$ref": "#/components/schemas/CaptureRequest"}},
    },
}
SCHEMAS = (Options, CaptureRequest, Handling)
"""Models that the OpenAPI document names only in the body above."""


@router.post(
    "/jobs",
    status_code=202,
    response_model=JobAnswer,
    openapi_extra={"requestBody": _BODY},
    responses=accepted(drivers.CameraNotFoundError),
)
async def create_job(
    request: Request,
    response: Response,
    context: Parts,
    caller: Calling,
    trace_id: TraceId,
    idempotency_key: IdempotencyKey = None,
    prefer: Annotated[
        str | None,
        Header(
            description=f"wait=N: answer when the job ends, after N (≤ {WAIT_SECONDS}) s at most."
        ),
    ] = None,
) -> JobAnswer:
    """Separate a pair of photographs, or have a camera take one and separate it."""
    await run_in_threadpool(refuse_when_full, context, caller, idempotency_key)
    limit, named = context.settings.upload_bytes, partial(fill_in, context, caller)
    async with intake.read(request, limit, named) as wanted:
        made = await run_in_threadpool(accept, context, caller, wanted, idempotency_key, trace_id)
    await _wait(context, caller, made.job_id, _preferred_wait(prefer))
    response.headers.update(made.headers)
    return await run_in_threadpool(answer, context, caller, made.job_id)


@router.get(
    "/jobs", response_model=JobPage, responses=responses(UnknownJobError, status=(422, 503))
)
def list_jobs(
    context: Parts,
    caller: Calling,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
    after: Annotated[
        str | None, Query(description="Id of the last job of the page before.")
    ] = None,
) -> JobPage:
    """List jobs, newest first."""
    with context.engine.connect() as connection:
        last = find(connection, caller, after) if after else None
        found = jobs.page(connection, caller.owner, limit + 1, last)
        shown = found[:limit]
        places = jobs.positions(connection, shown)
    more = len(found) > limit
    return JobPage(
        jobs=[JobAnswer.of(job, places.get(job.id)) for job in shown],
        next=f"/jobs?limit={limit}&after={shown[-1].id}" if more else None,
    )


@router.get(
    "/jobs/{job_id}",
    response_model=JobAnswer,
    responses=responses(UnknownJobError, status=(503,)),
)
def get_job(context: Parts, caller: Calling, job_id: str) -> JobAnswer:
    """Tell how far a job is, what it gave, or why it failed."""
    return answer(context, caller, job_id)


@router.post(
    "/jobs/{job_id}/cancel",
    status_code=202,
    response_model=JobAnswer,
    responses=responses(UnknownJobError, status=(503,)),
)
def cancel_job(context: Parts, caller: Calling, job_id: str) -> JobAnswer:
    """Stop a job; one that has ended stays as it is."""
    with context.engine.begin() as connection:
        find(connection, caller, job_id)
        jobs.request_cancel(connection, job_id, context.settings.retention_seconds)
        job = find(connection, caller, job_id)
    if job.state == State.CANCELED:
        context.queue.withdraw(job_id)
    return answer(context, caller, job_id)


@router.delete(
    "/jobs/{job_id}", status_code=204, responses=responses(UnknownJobError, status=(503,))
)
def delete_job(context: Parts, caller: Calling, job_id: str) -> None:
    """Delete a job with its photographs and results; a running one is stopped first."""
    with context.engine.begin() as connection:
        find(connection, caller, job_id)
        jobs.request_cancel(connection, job_id)
        jobs.condemn(connection, job_id)  # whatever comes of the rest, a sweep finds it
        job = find(connection, caller, job_id)
    remove(context.engine, context.storage, job_id)
    if job.ended:  # a running one leaves the queue when its worker finds the row gone
        context.queue.forget(job_id)


def answer(context: Context, caller: Caller, job_id: str) -> JobAnswer:
    """Make the answer for a job. Raises UnknownJobError."""
    with context.engine.connect() as connection:
        job = find(connection, caller, job_id)
        places = jobs.positions(connection, [job])
    return JobAnswer.of(job, places.get(job_id))


def _preferred_wait(prefer: str | None) -> float:
    wait = re.search(r"(?:^|[,;\s])wait\s*=\s*(\d{1,9})", prefer or "")
    return min(int(wait[1]), WAIT_SECONDS) if wait else 0


async def _wait(context: Context, caller: Caller, job_id: str, seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if await run_in_threadpool(_has_ended, context, caller, job_id):
            return
        await asyncio.sleep(_LOOK_SECONDS)


def _has_ended(context: Context, caller: Caller, job_id: str) -> bool:
    with context.engine.connect() as connection:
        return find(connection, caller, job_id).ended
