"""Routes of calibrations, which are jobs whose results other jobs may name."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Header, Request, Response
from fastapi.concurrency import run_in_threadpool

from pipeline import errors as pipeline_errors
from pipeline.calibration.options import CameraCalibration, FlashCalibration, LampsCalibration
from service.api import intake
from service.api.accept import accept, refuse_when_full
from service.api.calibrated import fill_in
from service.api.context import Parts, TraceId
from service.api.jobs import answer
from service.api.models import Calibrated, JobAnswer
from service.api.problems import responses
from service.attempt import FRAMES
from service.errors import (
    CrashError,
    IdempotencyError,
    MalformedRequestError,
    QueueFullError,
    UnsupportedMediaError,
    UploadTooLargeError,
)

router = APIRouter(tags=["calibrations"])

_KIND_SCHEMAS = (FlashCalibration, CameraCalibration, LampsCalibration)
SCHEMAS = (Calibrated, *_KIND_SCHEMAS)
"""Models that the OpenAPI document names only in bodies."""

_FRAME = {"type": "string", "format": "binary"}
_BODY = {
    "required": True,
    "content": {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": [*FRAMES, "options"],
                "properties": {
                    "no_flash": {**_FRAME, "description": "The photograph without the flash."},
                    "flash": {**_FRAME, "description": "The photograph with the flash."},
                    "options": {
                        "type": "string",
                        "contentMediaType": "application/json",
                        "contentSchema": {
                            "oneOf": [
                                {"$ref": f"#/components/schemas/{model.__name__}"}
                                for model in _KIND_SCHEMAS
                            ]
                        },
                        "description": "What to calibrate, and the marks, as JSON text.",
                    },
                },
            }
        }
    },
}


@router.post(
    "/calibrations",
    status_code=202,
    response_model=JobAnswer,
    openapi_extra={"requestBody": _BODY},
    responses={
        202: {"headers": {"Location": {"schema": {"type": "string"}}}},
        **responses(
            MalformedRequestError,
            UploadTooLargeError,
            UnsupportedMediaError,
            pipeline_errors.InputError,
            IdempotencyError,
            QueueFullError,
            CrashError,
            status=(503,),
        ),
    },
)
async def create_calibration(
    request: Request,
    response: Response,
    context: Parts,
    trace_id: TraceId,
    idempotency_key: Annotated[
        str | None,
        Header(min_length=1, max_length=255, description="Makes sending twice as good as once."),
    ] = None,
) -> JobAnswer:
    """Calibrate a flash, a camera or lamps; a job, whose id other jobs' options may name."""
    await run_in_threadpool(refuse_when_full, context)
    limit, named = context.settings.upload_bytes, partial(fill_in, context)
    async with intake.read_calibration(request, limit, named) as wanted:
        job_id = await run_in_threadpool(accept, context, wanted, idempotency_key, trace_id)
    response.headers["Location"] = f"/jobs/{job_id}"
    return await run_in_threadpool(answer, context, job_id)
