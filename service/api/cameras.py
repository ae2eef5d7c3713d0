"""Routes of cameras: see them, set them, have them take pairs."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

import drivers
from pipeline.errors import OptionError
from service import answers
from service.allowed import check_camera
from service.answers import CameraAnswer, CameraSettings, JobList, SettingAnswer
from service.api import intake
from service.api.accepted_job import accepted
from service.api.admission import refuse_when_full
from service.api.bodies import json_content
from service.api.callers import Caller, Calling, Standing
from service.api.camera_discovery import WATCH_SECONDS
from service.api.captures import told_of
from service.api.context import Context, Parts, TraceId
from service.api.make_job import make_captures
from service.api.models import CameraCapture, SettingsRequest
from service.api.problems import responses
from service.api.streams import KEEP_ALIVE_SECONDS, RETRY, stream_events
from service.api.submission import Submitting
from service.capture import CaptureSettings
from service.errors import (
    CameraHeldError,
    ForeignCameraError,
    NoProcessError,
    NotReadyError,
    SlowRequestError,
    StorageFullError,
    UnknownCameraError,
    UnknownJobError,
    UnsupportedMediaError,
    UploadTooLargeError,
)
from service.rows import bursts, cameras, jobs
from service.rows.database import AWAY
from service.rows.states import State

router = APIRouter(tags=["cameras"])

SCHEMAS = (CameraCapture, SettingsRequest)
"""Models that the OpenAPI document names only in bodies."""

_BODY = {"content": json_content(CameraCapture)}
_SETTINGS_BODY = {"required": True, "content": json_content(SettingsRequest)}
_PATIENCE_SECONDS = 10.0  # a request waits so long for cameras that are slow to answer
_LOOK_SECONDS = 0.5
_PROBLEMS = (
    UnknownCameraError,
    CameraHeldError,
    ForeignCameraError,
    drivers.CameraNotFoundError,
    drivers.SettingError,
    drivers.DriverError,
    NoProcessError,
    StorageFullError,
)


@router.get("/cameras", response_model=list[CameraAnswer], responses=responses(status=(503,)))
async def list_cameras(context: Parts, caller: Calling) -> list[CameraAnswer]:
    """List the cameras that are found here, named in the settings, or in use, as they are now."""
    looked = asyncio.shield(asyncio.wrap_future(context.camera_discovery.refresh()))
    with contextlib.suppress(TimeoutError):  # in no thread, of which other requests need one
        await asyncio.wait_for(looked, _PATIENCE_SECONDS)
    found = await run_in_threadpool(context.camera_discovery.listed)
    return _answers(context, caller, found)


@router.get(
    "/cameras/events",
    response_class=Response,
    responses={
        200: {
            "description": "All cameras as GET /cameras lists them, at once and after each change.",
            "content": {"text/event-stream": {"schema": {}}},
        },
        **responses(status=(503,)),
    },
)
async def watch_cameras(context: Parts, caller: Calling) -> Response:
    """Watch the cameras by server-sent events."""
    return stream_events(_events(context, caller))


@router.get(
    "/cameras/{camera_id}/settings",
    response_model=CameraSettings,
    responses=responses(*_PROBLEMS, status=(422, 503)),
)
async def get_settings(
    context: Parts, caller: Calling, trace_id: TraceId, camera_id: str
) -> CameraSettings:
    """Read the settings of a camera that no job has: what each is, and what it could be."""
    return await _adjust(context, caller, camera_id, {}, trace_id)


@router.patch(
    "/cameras/{camera_id}/settings",
    response_model=CameraSettings,
    openapi_extra={"requestBody": _SETTINGS_BODY},
    responses=responses(
        *_PROBLEMS,
        UploadTooLargeError,
        UnsupportedMediaError,
        SlowRequestError,
        OptionError,
        status=(503,),
    ),
)
async def change_settings(
    request: Request,
    context: Parts,
    caller: Calling,
    trace_id: TraceId,
    camera_id: str,
) -> CameraSettings:
    """Write settings of a camera that no job has, one by one, and read all of them back.

    Program, focus and drive come first, then the others in the order of the answer. Where one is
    refused, those before it stay written.
    """
    wanted = await intake.read_settings(request)
    return await _adjust(context, caller, camera_id, wanted, trace_id)


@router.post(
    "/cameras/{camera_id}/captures",
    status_code=202,
    response_model=JobList,
    openapi_extra={"requestBody": _BODY},
    responses=accepted(
        UnknownCameraError,
        UnknownJobError,
        CameraHeldError,
        ForeignCameraError,
        NotReadyError,
        drivers.SettingError,
    ),
)
async def capture(
    request: Request,
    response: Response,
    submission: Submitting,
    camera_id: str,
) -> JobList:
    """Have a camera take one pair or several, each separated by a job of its own."""
    await run_in_threadpool(refuse_when_full, submission)
    context = submission.context
    address = await run_in_threadpool(_address, context, camera_id)
    wanted, named = await intake.read_captures(request)
    made = await make_captures(submission, address, wanted, named)
    response.headers.update(made.headers)
    return await run_in_threadpool(_jobs, context, made.job_id)


def _jobs(context: Context, job_id: str) -> JobList:
    """Those of a job's burst; one that was deleted since an earlier answer is left out."""
    with context.engine.connect() as connection:
        kept = jobs.find_all(connection, bursts.kept(connection, job_id))
        found = sorted(kept, key=lambda job: job.id)
        return JobList(jobs=answers.of_jobs(connection, context.settings, found))


def _answers(context: Context, caller: Caller, found: list[cameras.Camera]) -> list[CameraAnswer]:
    is_unable = context.camera_discovery.is_unable
    return [_answer(camera, caller, is_unable(camera.address)) for camera in found]


def _answer(camera: cameras.Camera, caller: Caller, unable: bool) -> CameraAnswer:
    holder = camera.holder
    return CameraAnswer(
        id=camera.id,
        address=camera.address,
        make=camera.make,
        model=camera.model,
        serial=camera.serial,
        state=_state(camera, unable),
        battery_percent=camera.battery_percent,
        free_bytes=camera.free_bytes,
        holder=holder.id if holder and caller.may_see(holder) else None,
        waiting=camera.waiting,
    )


def _state(camera: cameras.Camera, unable: bool) -> Any:
    if camera.holder:
        waits = camera.holder.state == State.WAITING_FOR_OPERATOR
        return "waiting_for_operator" if waits else "capturing"
    if not camera.answered:
        return "away"
    return "unable" if unable else "idle"


async def _events(context: Context, caller: Caller) -> AsyncIterator[bytes]:
    yield RETRY
    seen, told = None, time.monotonic()
    standing = Standing(context.engine, caller)
    while not context.job_updates.closed and await standing.holds():
        with contextlib.suppress(*AWAY):  # they wait on: the database may come back
            context.camera_discovery.refresh()
            listed = _answers(context, caller, await context.camera_discovery.watched())
            news = json.dumps([camera.model_dump() for camera in listed])
            if news != seen:
                seen, told = news, time.monotonic()
                yield format_sse_event(data_str=news)
        if time.monotonic() - told > KEEP_ALIVE_SECONDS:
            told = time.monotonic()
            yield KEEPALIVE_COMMENT
        await asyncio.sleep(WATCH_SECONDS)


def _address(context: Context, camera_id: str) -> str:
    """Address of a camera, which may be one that is not allowed. Raises UnknownCameraError."""
    known = {cameras.id_of(address): address for address in context.camera_discovery.addresses()}
    if camera_id not in known:
        with context.engine.connect() as connection:
            address = cameras.address_of(connection, camera_id)
        if address is None:
            raise UnknownCameraError(
                f"There is no camera {camera_id[:32]!r}; GET /cameras lists those that there are."
            )
        known[camera_id] = address
    return known[camera_id]


async def _adjust(
    context: Context,
    caller: Caller,
    camera_id: str,
    wanted: CaptureSettings,
    trace_id: str,
) -> CameraSettings:
    deadline = time.monotonic() + _PATIENCE_SECONDS  # with the wait for a thread
    return await context.ask_camera(
        _adjust_by, context, caller, camera_id, wanted, trace_id, deadline
    )


def _adjust_by(
    context: Context,
    caller: Caller,
    camera_id: str,
    settings: CaptureSettings,
    trace_id: str,
    deadline: float,
) -> CameraSettings:
    address = _address(context, camera_id)
    check_camera(context.settings, address)
    while (found := context.camera_discovery.adjust(address, settings, trace_id)) is None:
        with context.engine.connect() as connection:
            holder = cameras.holder(connection, camera_id)
        if holder or time.monotonic() > deadline:
            who = told_of(holder, caller) if holder else "Another request"
            raise CameraHeldError(f"{who} has the camera; try again when it has ended.")
        time.sleep(_LOOK_SECONDS)  # somebody looks at it
    return {name: SettingAnswer(**setting) for name, setting in found.items()}
