"""The route that makes a job of the photographs of an earlier one."""

from __future__ import annotations

import uuid

from fastapi import APIRouter, Request, Response

from pipeline.errors import OptionError
from service.allowed import check_webhook
from service.answers import JobAnswer
from service.api import intake
from service.api.accepted_job import Accepted, accepted
from service.api.admission import replay_or_admit
from service.api.bodies import json_content
from service.api.callers import find
from service.api.commit_job import commit
from service.api.idempotency import as_asked, digest
from service.api.job_answers import answer_made
from service.api.models import RerunRequest
from service.api.named_calibrations import fill_in
from service.api.prefer import APPLIED, Wait
from service.api.submission import Submission, Submitting
from service.copy_pair import copy_pair
from service.errors import GoneError, NotReadyError, UnknownJobError
from service.job_options import check_options

router = APIRouter(tags=["jobs"])

SCHEMAS = (RerunRequest,)
"""Models that the OpenAPI document names only in bodies."""

_BODY = {"content": json_content(RerunRequest)}


@router.post(
    "/jobs/{job_id}/rerun",
    status_code=202,
    response_model=JobAnswer,
    openapi_extra={"requestBody": _BODY},
    responses=accepted(UnknownJobError, NotReadyError, GoneError, headers=APPLIED),
)
async def rerun_job(
    request: Request,
    response: Response,
    submission: Submitting,
    job_id: str,
    wait: Wait,
) -> JobAnswer:
    """Do a job again on copies of its photographs, with these options or the same ones."""
    context = submission.context
    wanted = await intake.read_rerun(request)
    made = await context.store(_accept, submission, job_id, wanted)
    return await answer_made(submission, made, wait, response)


def _accept(submission: Submission, job_id: str, wanted: RerunRequest) -> Accepted:
    """Copy the pair for good, then commit row and queue entry together."""
    context, caller = submission.context, submission.caller
    request_hash = digest({"rerun": job_id, "wanted": as_asked(wanted)})
    # Before the job is looked at, which may have been deleted since the first answer got lost.
    if earlier := replay_or_admit(submission, request_hash):
        return earlier
    check_webhook(context.settings, wanted.webhook_url)
    with context.engine.connect() as connection:
        source = find(connection, caller, job_id)
    if source.task == "mix":
        raise OptionError(
            "The job is a mix, which has no photographs of its own; mix the layers again, or run "
            "the job again that they are of."
        )
    given = wanted.options
    asked = source.options if given is None else fill_in(context, caller, given)
    options = check_options(source.task, asked)
    new_id = uuid.uuid4().hex
    values = copy_pair(context.storage, source, new_id, wanted.swapped) | {
        "id": new_id,
        "request_hash": request_hash,
    }
    return commit(submission, values, options, wanted, taken={})
