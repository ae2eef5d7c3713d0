"""Reads the body of POST /jobs without ever holding more than a part of it, up to a limit."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

from fastapi import Request
from pydantic import ValidationError
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.types import Message

from pipeline.errors import OptionError
from pipeline.options import Options
from service.api.models import CaptureRequest
from service.attempt import FRAMES
from service.errors import (
    MalformedRequestError,
    UnsupportedMediaError,
    UploadTooLargeError,
    sentence_of,
)

_JSON_BYTES = 1024 * 1024


@dataclass(frozen=True)
class Intake:
    """A request for a job: a pair of files by frame, or a camera to take it; and the options."""

    options: Options
    files: dict[str, UploadFile]
    capture: dict[str, Any] | None


@asynccontextmanager
async def read(request: Request, limit: int) -> AsyncIterator[Intake]:
    """Read the request's job; its files live as long as the context.

    limit: bytes. Raises MalformedRequestError, UnsupportedMediaError, UploadTooLargeError,
    OptionError.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind == "application/json":
        yield await _read_json(_limited(request, min(limit, _JSON_BYTES)))
    elif kind == "multipart/form-data":
        body = _limited(request, limit)
        try:
            form = await body.form(max_files=2, max_fields=1, max_part_size=_JSON_BYTES)
        except HTTPException as error:
            raise MalformedRequestError(
                f"The multipart body cannot be read: {error.detail}"
            ) from error
        try:
            yield _pair(dict(form.multi_items()))
        finally:
            await form.close()
    else:
        raise UnsupportedMediaError(
            "Send a pair as multipart/form-data with the parts no_flash and flash, "
            "or a capture as application/json."
        )


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


async def _read_json(request: Request) -> Intake:
    try:
        wanted = CaptureRequest.model_validate_json(await request.body())
    except ValidationError as error:
        raise OptionError(sentence_of(error)) from error
    return Intake(wanted.options, {}, wanted.capture.model_dump())


def _pair(form: dict[str, UploadFile | str]) -> Intake:
    unknown = sorted(set(form) - {*FRAMES, "options"})
    if unknown:
        raise MalformedRequestError(
            f"The part {unknown[0]!r} is unknown; the parts are no_flash, flash and options."
        )
    files = {}
    for frame in FRAMES:
        file = form.get(frame)
        if not isinstance(file, UploadFile):
            raise MalformedRequestError(f"The file {frame} is missing; send no_flash and flash.")
        files[frame] = file
    options = form.get("options", "{}")
    if not isinstance(options, str):
        raise MalformedRequestError("The part options must be JSON text, not a file.")
    return Intake(parse_options(options), files, None)


def parse_options(text: str) -> Options:
    """Options from JSON text. Raises OptionError."""
    try:
        return Options.model_validate_json(text)
    except ValidationError as error:
        raise OptionError(sentence_of(error)) from error
