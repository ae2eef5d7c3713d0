"""Route of mixes: jobs that make one picture of the layers of another job."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool

from pipeline.errors import InputError
from service.answers import JobAnswer
from service.api import intake
from service.api.accept_pair import accept_pair
from service.api.accepted_job import Accepted, accepted
from service.api.admission import refuse_when_full
from service.api.bodies import json_content
from service.api.find_results import find_succeeded
from service.api.idempotency import hash_of, replay
from service.api.job_answers import answer_made
from service.api.models import MixJob
from service.api.prefer import APPLIED, Wait
from service.api.submission import Submission, Submitting
from service.errors import GoneError, NotReadyError, UnknownJobError
from service.mixing import MixOptions, check_mix

router = APIRouter(tags=["mixes"])

SCHEMAS = (MixJob, MixOptions)
"""Models that the OpenAPI document names only in bodies."""

_BODY = {"required": True, "content": json_content(MixJob)}


@router.post(
    "/jobs/{job_id}/mix",
    status_code=202,
    response_model=JobAnswer,
    openapi_extra={"requestBody": _BODY},
    responses=accepted(InputError, UnknownJobError, NotReadyError, GoneError, headers=APPLIED),
)
async def create_mix(
    request: Request,
    response: Response,
    submission: Submitting,
    job_id: str,
    wait: Wait,
) -> JobAnswer:
    """Mix the layers of a job into a picture of full size; a job of its own."""
    await run_in_threadpool(refuse_when_full, submission)
    context = submission.context
    wanted = await intake.read_mix(request, context.settings.upload_bytes, job_id)
    made = await context.store(_accept, submission, wanted)
    return await answer_made(submission, made, wait, response)


def _accept(submission: Submission, wanted: intake.Intake) -> Accepted:
    assert isinstance(wanted.options, MixOptions)
    # Before the job is looked at, which may have been deleted since the first answer got lost.
    if earlier := replay(submission, hash_of(wanted)):
        return earlier
    context, options = submission.context, wanted.options
    source = find_succeeded(context, submission.caller, options.of)
    check_mix(context.storage, source, options.mix)
    return accept_pair(submission, wanted)
