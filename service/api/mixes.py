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
from service.api.accept import Accepted, accept, hash_of, refuse_when_full, replay
from service.api.callers import Caller, Calling
from service.api.context import Context, Parts, TraceId
from service.api.jobs import answer_made
from service.api.models import MixJob, MixOptions
from service.api.pair_form import IdempotencyKey, accepted
from service.api.prefer import APPLIED, Wait
from service.api.results import deleted_meanwhile, find_succeeded
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
    context: Parts,
    caller: Calling,
    trace_id: TraceId,
    job_id: str,
    wait: Wait,
    idempotency_key: IdempotencyKey = None,
) -> JobAnswer:
    """Mix the layers of a job into a picture of full size; a job of its own."""
    await run_in_threadpool(refuse_when_full, context, caller, idempotency_key)
    wanted = await intake.read_mix(request, context.settings.upload_bytes, job_id)
    made = await context.store(_accept, context, caller, wanted, idempotency_key, trace_id)
    return await answer_made(context, caller, made, wait, response)


def _accept(
    context: Context,
    caller: Caller,
    wanted: intake.Intake,
    idempotency_key: str | None,
    trace_id: str,
) -> Accepted:
    assert isinstance(wanted.options, MixOptions)
    # Before the job is looked at, which may have been deleted since the first answer got lost.
    if earlier := replay(context, caller, idempotency_key, hash_of(wanted)):
        return earlier
    _check(context, caller, wanted.options.of, wanted.options.mix)
    return accept(context, caller, wanted, idempotency_key, trace_id)


def _check(context: Context, caller: Caller, job_id: str, mix: Mix) -> None:
    """Refuse what could never be mixed."""
    job = find_succeeded(context, caller, job_id)
    if not {LAYERS, MANIFEST} <= {result["name"] for result in job.results or []}:
        raise OptionError(f"The job has no {LAYERS} to mix; separate the pair with that output.")
    with deleted_meanwhile():
        manifest = context.storage.get(results_key(job.id, job.attempt, MANIFEST))
    check_lamps(read_basis(json.loads(manifest)), mix)
