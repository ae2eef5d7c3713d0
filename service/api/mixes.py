"""Route of mixes: jobs that make one picture of the layers of another job."""

from __future__ import annotations

import uuid

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool

from pipeline.errors import InputError
from pipeline.mixes.mix_options import MixRequest
from service.allowed import check_webhook
from service.answers import JobAnswer
from service.api import intake
from service.api.accepted_job import Accepted, accepted
from service.api.admission import refuse_when_full
from service.api.bodies import json_content
from service.api.commit_job import commit
from service.api.find_results import find_succeeded
from service.api.idempotency import hash_of_mix, replay
from service.api.job_answers import answer_made
from service.api.models import Handling, MixJob
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
    wanted = await intake.read_mix(request)
    made = await context.store(_accept, submission, job_id, wanted)
    return await answer_made(submission, made, wait, response)


def _accept(submission: Submission, job_id: str, wanted: MixJob) -> Accepted:
    """Commit row and queue entry together."""
    context, handling = submission.context, intake.handling_of(wanted)
    mix = wanted.model_dump(exclude=set(Handling.model_fields), exclude_unset=True)
    options = MixOptions(kind="mix", of=job_id, mix=MixRequest.model_validate(mix))
    request_hash = hash_of_mix(options, handling)
    # Before the job is looked at, which may have been deleted since the first answer got lost.
    if earlier := replay(submission, request_hash):
        return earlier
    check_webhook(context.settings, handling.webhook_url)
    source = find_succeeded(context, submission.caller, job_id)
    check_mix(context.storage, source, options.mix)
    refuse_when_full(submission)  # others may have come while the store was read
    values = {"id": uuid.uuid4().hex, "request_hash": request_hash}
    return commit(submission, values, options, handling, taken={})
