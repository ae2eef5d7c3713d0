"""Routes of calibrations, which are jobs whose results other jobs may name."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from pipeline.calibration.options import CameraCalibration, FlashCalibration, LampsCalibration
from service.answers import JobAnswer, KeptCalibration, KeptCalibrations, Links
from service.api import captures, intake, pair_form
from service.api.accepted_job import accepted
from service.api.admission import refuse_when_full
from service.api.bodies import json_content, schema_of
from service.api.callers import Calling
from service.api.context import Parts
from service.api.job_answers import answer_made
from service.api.make_job import make_job
from service.api.models import Calibrated, CalibrationCaptureRequest, CalibrationRequest
from service.api.prefer import APPLIED, Wait
from service.api.problems import responses
from service.api.submission import Submitting
from service.rows import jobs, kept

router = APIRouter(tags=["calibrations"])

_KIND_SCHEMAS = (FlashCalibration, CameraCalibration, LampsCalibration)
SCHEMAS = (Calibrated, CalibrationRequest, CalibrationCaptureRequest, *_KIND_SCHEMAS)
"""Models that the OpenAPI document names only in bodies."""

_BODY = {
    "required": True,
    "content": {
        **pair_form.describe(
            schema_of(*_KIND_SCHEMAS),
            "What to calibrate, and the marks, as JSON text.",
            required=True,
        ),
        **json_content(CalibrationCaptureRequest, CalibrationRequest),
    },
}


@router.post(
    "/calibrations",
    status_code=202,
    response_model=JobAnswer,
    openapi_extra={"requestBody": _BODY},
    responses=accepted(*pair_form.PROBLEMS, *captures.PROBLEMS, headers=APPLIED),
)
async def create_calibration(
    request: Request,
    response: Response,
    submission: Submitting,
    wait: Wait,
) -> JobAnswer:
    """Calibrate a flash, a camera or lamps, on a pair sent or taken; a job that others may name."""
    await run_in_threadpool(refuse_when_full, submission)
    async with intake.read_calibration(request, submission.context.settings) as wanted:
        made = await make_job(submission, wanted)
    return await answer_made(submission, made, wait, response)


@router.get(
    "/calibrations", response_model=KeptCalibrations, responses=responses(status=(422, 503))
)
def list_calibrations(
    context: Parts,
    caller: Calling,
    camera: Annotated[
        str | None, Query(description="Part of a camera's make and model, in any case.")
    ] = None,
    setup: Annotated[str | None, Query(description="Name of a set-up.")] = None,
) -> KeptCalibrations:
    """List the calibrations that are kept for a camera and a set-up, newest first."""
    with context.engine.connect() as connection:
        rows = jobs.kept_calibrations(connection, caller.owner, setup)
    listed = [_kept(row) for row in rows]
    wanted = (camera or "").casefold()
    return KeptCalibrations(calibrations=[one for one in listed if wanted in one.camera.casefold()])


def _kept(row: jobs.Job) -> KeptCalibration:
    of, here = kept.taken_with(row), f"/jobs/{row.id}"
    return KeptCalibration(
        id=row.id,
        kind=row.options["kind"],
        setup=row.options["setup"],
        camera=f"{of.make} {of.model}".strip(),
        made=datetime.fromisoformat(kept.made_at(row)),
        links=Links(self=here, results=f"{here}/results", zip=f"{here}/results.zip"),
    )
