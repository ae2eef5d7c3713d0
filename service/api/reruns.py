"""The route that makes a job of the photographs of an earlier one."""

from __future__ import annotations

import uuid
from typing import Any

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel

from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.errors import OptionError
from pipeline.options import Options
from service import jobs
from service.answers import JobAnswer
from service.api import intake
from service.api.accept import (
    Accepted,
    as_asked,
    check_webhook,
    commit,
    digest,
    refuse_when_full,
    replay,
)
from service.api.calibrated import fill_in
from service.api.callers import Caller, Calling, find
from service.api.context import Context, Parts, TraceId
from service.api.jobs import answer_made
from service.api.models import RerunRequest
from service.api.pair_form import IdempotencyKey, accepted
from service.api.prefer import APPLIED, Wait
from service.errors import GoneError, NotReadyError, UnknownJobError
from service.repeat import copy_pair
from service.sentences import in_words

router = APIRouter(tags=["jobs"])

SCHEMAS = (RerunRequest,)
"""Models that the OpenAPI document names only in bodies."""

_BODY = {
    "content": {
        "application/json": {"schema": {"$ref": f"#/components/schemas/{RerunRequest.__name__}"}}
    }
}


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
    context: Parts,
    caller: Calling,
    trace_id: TraceId,
    job_id: str,
    wait: Wait,
    idempotency_key: IdempotencyKey = None,
) -> JobAnswer:
    """Do a job again on copies of its photographs, with these options or the same ones."""
    wanted = await intake.read_rerun(request, context.settings.upload_bytes)
    made = await context.store(_accept, context, caller, job_id, wanted, idempotency_key, trace_id)
    return await answer_made(context, caller, made, wait, response)


def _accept(
    context: Context,
    caller: Caller,
    job_id: str,
    wanted: RerunRequest,
    idempotency_key: str | None,
    trace_id: str,
) -> Accepted:
    """Copy the pair for good, then commit row and queue entry together."""
    refuse_when_full(context, caller, idempotency_key)
    check_webhook(context, wanted)
    request_hash = digest({"rerun": job_id, "wanted": as_asked(wanted)})
    # Before the job is looked at, which may have been deleted since the first answer got lost.
    if earlier := replay(context, caller, idempotency_key, request_hash):
        return earlier
    with context.engine.connect() as connection:
        source = find(connection, caller, job_id)
    if source.task == "mix":
        raise OptionError(
            "The job is a mix, which has no photographs of its own; mix the layers again, or run "
            "the job again that they are of."
        )
    options = _options(context, caller, source, wanted.options)
    new_id = uuid.uuid4().hex
    values = copy_pair(context.storage, source, new_id) | {
        "id": new_id,
        "trace_id": trace_id,
        "idempotency_key": idempotency_key,
        "request_hash": request_hash,
    }
    return commit(context, caller, values, options, wanted, taken={})


def _options(
    context: Context, caller: Caller, source: jobs.Job, wanted: dict[str, Any] | None
) -> BaseModel:
    options = source.options if wanted is None else fill_in(context, caller, wanted)
    with in_words():
        if source.task == "calibrate":
            return CALIBRATION_OPTIONS.validate_python(options)
        return Options.model_validate(options)
