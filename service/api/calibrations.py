"""Routes of calibrations, which are jobs whose results other jobs may name."""

from __future__ import annotations

from functools import partial

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool

from pipeline.calibration.options import CameraCalibration, FlashCalibration, LampsCalibration
from service.api import intake
from service.api.accept import accept, refuse_when_full
from service.api.calibrated import fill_in
from service.api.callers import Calling
from service.api.context import Parts, TraceId
from service.api.jobs import answer
from service.api.models import Calibrated, CalibrationRequest, JobAnswer
from service.api.pair_form import IdempotencyKey, accepted, pair_form

router = APIRouter(tags=["calibrations"])

_KIND_SCHEMAS = (FlashCalibration, CameraCalibration, LampsCalibration)
SCHEMAS = (Calibrated, CalibrationRequest, *_KIND_SCHEMAS)
"""Models that the OpenAPI document names only in bodies."""

_BODY = {
    "required": True,
    "content": {
        **pair_form(
            {"oneOf": [{"$ref": f"#/components/schemas/{one.__name__}"} for one in _KIND_SCHEMAS]},
            "What to calibrate, and the marks, as JSON text.",
            required=True,
        ),
        "application/json": {"schema": {"$ref": "#/components/schemas/CalibrationRequest"}},
    },
}


@router.post(
    "/calibrations",
    status_code=202,
    response_model=JobAnswer,
    openapi_extra={"requestBody": _BODY},
    responses=accepted(),
)
async def create_calibration(
    request: Request,
    response: Response,
    context: Parts,
    caller: Calling,
    trace_id: TraceId,
    idempotency_key: IdempotencyKey = None,
) -> JobAnswer:
    """Calibrate a flash, a camera or lamps; a job, whose id other jobs' options may name."""
    await run_in_threadpool(refuse_when_full, context, caller, idempotency_key)
    named = partial(fill_in, context, caller)
    async with intake.read_calibration(request, context.settings, named) as wanted:
        made = await run_in_threadpool(accept, context, caller, wanted, idempotency_key, trace_id)
    response.headers.update(made.headers)
    return await run_in_threadpool(answer, context, caller, made.job_id)
