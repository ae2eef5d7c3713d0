"""Route of mixes: jobs that make one picture of the layers of another job."""

from __future__ import annotations

import json

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool

from pipeline.errors import InputError, OptionError
from pipeline.mix_options import Mix, check_lamps, read_basis
from pipeline.result_names import LAYERS, MANIFEST
from service.answers import JobAnswer
from service.api import intake
from service.api.accept import accept
from service.api.accepted import Accepted, accepted
from service.api.admission import refuse_when_full
from service.api.callers import Caller
from service.api.context import Context
from service.api.finished import deleted_meanwhile, find_succeeded
from service.api.idempotency import hash_of, replay
from service.api.job_answers import answer_made
from service.api.models import MixJob, MixOptions
from service.api.prefer import APPLIED, Wait
from service.api.submission import Submission, Submitting
from service.errors import GoneError, NotReadyError, UnknownJobError
from service.object_keys import results_key

router = APIRouter(tags=["mixes"])

SCHEMAS = (MixJob, MixOptions)
"""Models that the OpenAPI document names only in bodies."""

_BODY = {
    "required": True,
    "content": {
        "application/json": {"schema": {"$ref": f"#/components/schemas/{MixJob.__name__}"}}
    },
}


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
    _check(submission.context, submission.caller, wanted.options.of, wanted.options.mix)
    return accept(submission, wanted)


def _check(context: Context, caller: Caller, job_id: str, mix: Mix) -> None:
    """Refuse what could never be mixed."""
    job = find_succeeded(context, caller, job_id)
    if not {LAYERS, MANIFEST} <= {result["name"] for result in job.results or []}:
        raise OptionError(f"The job has no {LAYERS} to mix; separate the pair with that output.")
    with deleted_meanwhile():
        manifest = context.storage.get(results_key(job.id, job.attempt, MANIFEST))
    check_lamps(read_basis(json.loads(manifest)), mix)
