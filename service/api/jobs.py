"""Routes of jobs: make, list, watch, cancel, delete."""

from __future__ import annotations

import re
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import AfterValidator, Field
from sqlalchemy.exc import DBAPIError

from pipeline.options import Options
from service import answers, steering
from service.answers import JobAnswer, JobPage
from service.api import captures, intake, pair_form
from service.api.accepted_job import accepted
from service.api.admission import refuse_when_full
from service.api.bodies import json_content, schema_of
from service.api.callers import Caller, Calling, find
from service.api.context import Context, Parts
from service.api.job_answers import answer, answer_made
from service.api.make_job import make_job
from service.api.models import CaptureRequest, Handling, UploadsRequest
from service.api.prefer import APPLIED, Wait
from service.api.problems import responses
from service.api.submission import Submitting
from service.errors import NotReadyError, UnknownJobError
from service.object_keys import job_key
from service.retention import remove
from service.rows import expiry, jobs
from service.rows.database import is_full

router = APIRouter(tags=["jobs"])

_BODY = {
    "required": True,
    "content": {
        **pair_form.describe(schema_of(Options), "Options as JSON text."),
        **json_content(CaptureRequest, UploadsRequest),
    },
}
SCHEMAS = (Options, CaptureRequest, UploadsRequest, Handling)
"""Models that the OpenAPI document names only in the body above."""

_PLACE = r"[0-9]{1,12}\.[0-9]{1,12}-[0-9a-f]{32}"
"""Of a job in the list: when it was made, and its id. It holds when the job is deleted."""


def _check_place(place: str) -> str:
    if not re.fullmatch(_PLACE, place):
        raise ValueError("use the whole address that `next` of the page before gives")
    return place


_Place = Annotated[
    str, AfterValidator(_check_place), Field(json_schema_extra={"pattern": f"^{_PLACE}$"})
]


@router.post(
    "/jobs",
    status_code=202,
    response_model=JobAnswer,
    openapi_extra={"requestBody": _BODY},
    responses=accepted(*pair_form.PROBLEMS, *captures.PROBLEMS, headers=APPLIED),
)
async def create_job(
    request: Request,
    response: Response,
    submission: Submitting,
    wait: Wait,
) -> JobAnswer:
    """Separate a pair of photographs, or have a camera take one and separate it."""
    await run_in_threadpool(refuse_when_full, submission)
    async with intake.read(request, submission.context.settings) as wanted:
        made = await make_job(submission, wanted)
    return await answer_made(submission, made, wait, response)


@router.get("/jobs", response_model=JobPage, responses=responses(status=(422, 503)))
def list_jobs(
    context: Parts,
    caller: Calling,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
    after: Annotated[
        _Place | None, Query(description="Where the page before ended, as its `next` says it.")
    ] = None,
) -> JobPage:
    """List jobs, newest first; fewer than `limit` where their options are long."""
    place = _read_place(after)
    with context.engine.connect() as connection:
        count = jobs.count_fitting(connection, caller.lists, limit, place)
        found = jobs.page(connection, caller.lists, count + 1, place)
        shown = found[:count]
        listed = answers.of_jobs(connection, context.settings, shown)
    more = len(found) > count
    return JobPage(
        jobs=listed,
        next=f"/jobs?limit={limit}&after={_place_of(shown[-1])}" if more else None,
    )


def _place_of(job: jobs.Job) -> str:
    return f"{job.created!r}-{job.id}"  # repr, as it gives back the very number


def _read_place(place: str | None) -> tuple[float, str] | None:
    if place is None:
        return None
    created, _, job_id = place.partition("-")
    return float(created), job_id


@router.get(
    "/jobs/{job_id}",
    response_model=JobAnswer,
    responses={200: {"headers": APPLIED}, **responses(UnknownJobError, status=(503,))},
)
async def get_job(context: Parts, caller: Calling, job_id: str, wait: Wait) -> JobAnswer:
    """Tell how far a job is, what it gave, or why it failed."""
    now = await run_in_threadpool(answer, context, caller, job_id)
    if not wait or now.links.cancel is None:
        return now
    await context.job_updates.until_over(job_id, wait)
    return await run_in_threadpool(answer, context, caller, job_id)


@router.post(
    "/jobs/{job_id}/cancel",
    status_code=202,
    response_model=JobAnswer,
    responses=responses(UnknownJobError, status=(503,)),
)
def cancel_job(context: Parts, caller: Calling, job_id: str) -> JobAnswer:
    """Stop a job; one that has ended stays as it is."""
    with context.engine.connect() as connection:
        find(connection, caller, job_id)
    steering.cancel(context.engine, context.queue, context.settings, job_id)
    return answer(context, caller, job_id)


@router.post(
    "/jobs/{job_id}/confirm",
    status_code=202,
    response_model=JobAnswer,
    responses=responses(UnknownJobError, NotReadyError, status=(503,)),
)
def confirm_job(
    context: Parts,
    caller: Calling,
    job_id: str,
    request: Annotated[
        int | None,
        Query(
            ge=1, le=2**31 - 1, description="Number of the request that is done; any without it."
        ),
    ] = None,
) -> JobAnswer:
    """Say that what a job asks its operator for is done, like switching the flash."""
    with context.engine.begin() as connection:
        steering.confirm(connection, find(connection, caller, job_id), request)
    return answer(context, caller, job_id)


@router.delete(
    "/jobs/{job_id}", status_code=204, responses=responses(UnknownJobError, status=(503,))
)
async def delete_job(context: Parts, caller: Calling, job_id: str) -> None:
    """Delete a job with its photographs and results; a running one is stopped first."""
    await context.store(_delete, context, caller, job_id)


def _delete(context: Context, caller: Caller, job_id: str) -> None:
    try:
        stopped = _condemn(context, caller, job_id)
    except DBAPIError as error:
        if not is_full(error):
            raise
        _make_room(context, caller, job_id)
        stopped = _condemn(context, caller, job_id)
    remove(context.engine, context.storage, job_id)
    # A running one leaves the queue when its worker finds the row gone.
    if stopped:
        context.queue.withdraw(job_id)


def _condemn(context: Context, caller: Caller, job_id: str) -> bool:
    """Stop a job and write that it goes: then a sweep finds it; whether it waited and has ended."""
    with context.engine.begin() as connection:
        waited = not find(connection, caller, job_id).ended
        jobs.request_cancel(connection, job_id)
        expiry.condemn(connection, job_id)
        return waited and find(connection, caller, job_id).ended


def _make_room(context: Context, caller: Caller, job_id: str) -> None:
    """Remove the files of a job that has ended: they may be on the disk of the database."""
    with context.engine.connect() as connection:
        job = find(connection, caller, job_id)
    if job.ended:
        context.storage.delete_below(job_key(job_id))
