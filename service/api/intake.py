"""Reads the body of an upload without ever holding more than a part of it, up to a limit."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from pydantic import ValidationError
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.types import Message

import drivers
from pipeline.calibration.options import (
    CALIBRATION_OPTIONS,
    CameraCalibration,
    FlashCalibration,
    LampsCalibration,
)
from pipeline.errors import OptionError
from pipeline.mix import MixRequest
from pipeline.options import Options
from service.api.models import CaptureRequest, Handling, MixJob, MixOptions
from service.attempt import FRAMES
from service.errors import (
    MalformedRequestError,
    UnsupportedMediaError,
    UploadTooLargeError,
    sentence_of,
)

_JSON_BYTES = 1024 * 1024

CalibrationRequest = FlashCalibration | CameraCalibration | LampsCalibration
FillIn = Callable[[Any], Any]
Form = dict[str, UploadFile | str]


@dataclass(frozen=True)
class Intake:
    """A request for a job: a pair of files by frame, or a camera to take it; and what is wanted.

    A mix has neither, but the other job in its options.
    """

    options: Options | CalibrationRequest | MixOptions
    handling: Handling
    files: dict[str, UploadFile]
    capture: dict[str, Any] | None


@asynccontextmanager
async def read(request: Request, limit: int, fill_in: FillIn) -> AsyncIterator[Intake]:
    """Read a request for a separation; its files live as long as the context.

    limit: bytes. fill_in: puts tables where options name calibrations. Raises
    MalformedRequestError, UnsupportedMediaError, UploadTooLargeError, OptionError, and for a camera
    that cannot be drivers.BadAddressError or CameraNotFoundError.
    """
    if _media_type(request) == "application/json":
        body = await _limited(request, min(limit, _JSON_BYTES)).body()
        yield await run_in_threadpool(_capture, body, fill_in)
        return
    async with _form(request, limit) as form:
        yield await run_in_threadpool(_pair, form, "{}", partial(_options, fill_in=fill_in))


@asynccontextmanager
async def read_calibration(request: Request, limit: int, fill_in: FillIn) -> AsyncIterator[Intake]:
    """Read a request for a calibration, as `read` does."""
    async with _form(request, limit) as form:
        yield await run_in_threadpool(_pair, form, "", partial(_calibration, fill_in=fill_in))


async def read_mix(request: Request, limit: int, job_id: str) -> Intake:
    """Read a request to mix the layers of a job; raises what `read` raises."""
    if _media_type(request) != "application/json":
        raise UnsupportedMediaError("Send the settings of the lamps as application/json.")
    body = await _limited(request, min(limit, _JSON_BYTES)).body()
    try:
        wanted = MixJob.model_validate_json(body)
    except ValidationError as error:
        raise OptionError(sentence_of(error)) from error
    given = wanted.model_dump(exclude_unset=True)
    handling = {name: given.pop(name) for name in Handling.model_fields if name in given}
    options = MixOptions(kind="mix", of=job_id, mix=MixRequest.model_validate(given))
    return Intake(options, Handling.model_validate(handling), {}, None)


def _media_type(request: Request) -> str:
    return request.headers.get("content-type", "").partition(";")[0].strip().lower()


@asynccontextmanager
async def _form(request: Request, limit: int) -> AsyncIterator[Form]:
    if _media_type(request) != "multipart/form-data":
        raise UnsupportedMediaError(
            "Send a pair as multipart/form-data with the parts no_flash, flash, options and "
            "handling, or, to have it separated, a capture as application/json."
        )
    body = _limited(request, limit)
    try:
        form = await body.form(max_files=2, max_fields=2, max_part_size=_JSON_BYTES)
    except HTTPException as error:
        raise MalformedRequestError(f"The multipart body cannot be read: {error.detail}") from error
    try:
        yield dict(form.multi_items())
    finally:
        await form.close()


def _limited(request: Request, limit: int) -> Request:
    too_large = UploadTooLargeError(
        f"The request is larger than {limit:,} bytes, which is all this service takes."
    )
    announced = request.headers.get("content-length", "")
    if announced.isdecimal() and int(announced) > limit:
        raise too_large
    received = 0

    async def receive() -> Message:
        nonlocal received
        message = await request.receive()
        received += len(message.get("body", b""))
        if received > limit:
            raise too_large
        return message

    return Request(request.scope, receive)


def _capture(body: bytes, fill_in: FillIn) -> Intake:
    try:
        values = json.loads(body)
    except (ValueError, RecursionError):  # told where it is read
        values = None
    if isinstance(values, dict) and "options" in values:
        values["options"] = fill_in(values["options"])
        body = json.dumps(values).encode()
    try:
        wanted = CaptureRequest.model_validate_json(body)
    except ValidationError as error:
        raise OptionError(sentence_of(error)) from error
    drivers.check_address(wanted.capture.camera)
    handling = Handling.model_validate(
        wanted.model_dump(include=set(Handling.model_fields), exclude_unset=True)
    )
    return Intake(wanted.options, handling, {}, wanted.capture.model_dump())


def _pair(form: Form, without: str, parse: Callable[[str], Options | CalibrationRequest]) -> Intake:
    """without: what stands for options that were not sent."""
    unknown = sorted(set(form) - {*FRAMES, "options", "handling"})
    if unknown:
        raise MalformedRequestError(
            f"The part {unknown[0]!r} is unknown; the parts are no_flash, flash, options and "
            "handling."
        )
    files = {}
    for frame in FRAMES:
        file = form.get(frame)
        if not isinstance(file, UploadFile):
            raise MalformedRequestError(f"The file {frame} is missing; send no_flash and flash.")
        files[frame] = file
    options = parse(_text(form, "options", without))
    return Intake(options, _handling(_text(form, "handling", "{}")), files, None)


def _text(form: Form, part: str, without: str) -> str:
    text = form.get(part, without)
    if not isinstance(text, str):
        raise MalformedRequestError(f"The part {part} must be JSON text, not a file.")
    return text


def _handling(text: str) -> Handling:
    try:
        return Handling.model_validate_json(text)
    except ValidationError as error:
        raise OptionError(sentence_of(error)) from error


def _options(text: str, fill_in: FillIn) -> Options:
    try:
        return Options.model_validate_json(_filled_in(text, fill_in))
    except ValidationError as error:
        raise OptionError(sentence_of(error)) from error


def _calibration(text: str, fill_in: FillIn) -> CalibrationRequest:
    if not text:
        raise MalformedRequestError("The part options is missing; it says what to calibrate.")
    try:
        return CALIBRATION_OPTIONS.validate_json(_filled_in(text, fill_in))
    except ValidationError as error:
        raise OptionError(sentence_of(error)) from error


def _filled_in(text: str, fill_in: FillIn) -> str:
    try:
        return json.dumps(fill_in(json.loads(text)))
    except (ValueError, RecursionError):
        return text  # what is wrong with it is told where it is read
