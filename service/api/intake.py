"""Reads a request for a job without ever holding more than a part of it, up to a limit.

JSON is taken at its word, in bodies and in parts of forms: "2" is no number, and 1 is no yes.
"""

from __future__ import annotations

import json
import re
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, AnyStr

from fastapi import Request
from fastapi.concurrency import contextmanager_in_threadpool, run_in_threadpool
from starlette.types import Message

import drivers
from pipeline.calibration.options import (
    CALIBRATION_OPTIONS,
    CameraCalibration,
    FlashCalibration,
    LampsCalibration,
)
from pipeline.errors import OptionError
from pipeline.options import Options
from service.api.form import Form, read_form
from service.api.models import (
    CalibrationCaptureRequest,
    CalibrationRequest,
    CameraCapture,
    CaptureRequest,
    Handling,
    MixJob,
    RerunRequest,
    SettingsRequest,
    UploadsRequest,
)
from service.calibration_names import take_out
from service.capture import Capture, CaptureSettings
from service.errors import MalformedRequestError, UnsupportedMediaError, UploadTooLargeError
from service.frames import FRAMES
from service.sentences import in_words
from service.settings import Settings
from service.workers import scratch

_JSON_BYTES = 1024 * 1024  # of a body, as of a part of a form that is text; no setting is less
_TEXTS = ("options", "handling")
_NUL = re.compile(r"(?<!\\)(?:\\\\)*\\u0000")
"""In JSON. PostgreSQL keeps it, and finds no other row any more once it has to read it."""

AnyOptions = Options | FlashCalibration | CameraCalibration | LampsCalibration


@dataclass(frozen=True)
class Intake:
    """A request for a job: a pair, or a camera to take it; and what is wanted.

    directory: where the photographs lie by frame, or are brought to, as long as the request is
    dealt with. sha256: of those that lie there already, by frame. uploads: ids of earlier uploads,
    by frame. calibrations: what the options name, as sent, by option; the options themselves have
    stand-ins there.
    """

    options: AnyOptions
    handling: Handling
    directory: Path
    sha256: dict[str, str] = field(default_factory=dict)
    uploads: dict[str, str] = field(default_factory=dict)
    capture: Capture | None = None
    calibrations: dict[str, Any] = field(default_factory=dict)


def read(request: Request, settings: Settings) -> AbstractAsyncContextManager[Intake]:
    """Read a request for a separation; its files live as long as the context.

    Raises MalformedRequestError, UnsupportedMediaError, UploadTooLargeError, OptionError, and for
    a camera that cannot be drivers.BadAddressError or CameraNotFoundError.
    """
    named = partial(_named, taken=CaptureRequest, sent=UploadsRequest)
    return _read(request, settings, named, _pair)


def read_calibration(request: Request, settings: Settings) -> AbstractAsyncContextManager[Intake]:
    """Read a request for a calibration, as `read` does."""
    named = partial(_named, taken=CalibrationCaptureRequest, sent=CalibrationRequest)
    return _read(request, settings, named, _calibration_pair)


@asynccontextmanager
async def _read(
    request: Request,
    settings: Settings,
    named: Callable[[bytes, Path], Intake],
    sent: Callable[[Form, Path], Intake],
) -> AsyncIterator[Intake]:
    async with contextmanager_in_threadpool(scratch.folder(settings.data_dir)) as directory:
        if _media_type(request) == "application/json":
            body = await _limited_json(request).body()
            yield await run_in_threadpool(named, body, directory)
        else:
            form = await _form(request, settings.upload_bytes, directory)
            yield await run_in_threadpool(sent, form, directory)


async def read_rerun(request: Request) -> RerunRequest:
    """Read a request for a rerun; an empty body asks for the same again.

    Raises UnsupportedMediaError, UploadTooLargeError, OptionError.
    """
    body = await _json_body(request, "what the rerun is to do", may_be_empty=True)
    with in_words():
        return RerunRequest.model_validate_json(_kept(body), strict=True)


async def read_mix(request: Request) -> MixJob:
    """Read a request to mix the layers of a job. Raises what `read_rerun` raises."""
    body = await _json_body(request, "the settings of the lamps")
    with in_words():
        return MixJob.model_validate_json(_kept(body), strict=True)


async def read_captures(request: Request) -> tuple[CameraCapture, dict[str, Any]]:
    """Read a request for pairs of one camera; an empty body asks for one as the camera is set.

    Also gives the calibrations that its options name, as an Intake has them. Raises what `read`
    raises.
    """
    body = await _json_body(request, "what the camera is to do", may_be_empty=True)
    _, body, named = await run_in_threadpool(_json, body)
    with in_words():
        return CameraCapture.model_validate_json(_kept(body), strict=True), named


async def read_settings(request: Request) -> CaptureSettings:
    """Read which settings of a camera to write. Raises what `read_rerun` raises."""
    body = await _json_body(request, "the settings of the camera")
    with in_words():
        return SettingsRequest.model_validate_json(_kept(body), strict=True).root


async def _json_body(request: Request, what: str, may_be_empty: bool = False) -> bytes:
    """Read a body of JSON. what: it says. may_be_empty: read an empty one as an empty object."""
    body = await _limited_json(request).body()
    if may_be_empty and not body:
        return b"{}"
    if _media_type(request) != "application/json":
        raise UnsupportedMediaError(f"Send {what} as application/json.")
    return body


def _media_type(request: Request) -> str:
    return request.headers.get("content-type", "").partition(";")[0].strip().lower()


async def _form(request: Request, limit: int, directory: Path) -> Form:
    if _media_type(request) != "multipart/form-data":
        raise UnsupportedMediaError(
            "Send a pair as multipart/form-data with the parts no_flash, flash, options and "
            "handling, or name uploads or a camera in application/json."
        )
    advice = "send smaller photographs, or have its operator raise LIGHTLAYERS_UPLOAD_BYTES"
    form = await read_form(_limited(request, limit, advice), directory, FRAMES, _TEXTS)
    for frame in FRAMES:
        if frame not in form.sha256:
            raise MalformedRequestError(f"The file {frame} is missing; send no_flash and flash.")
    return form


def _limited_json(request: Request) -> Request:
    return _limited(request, _JSON_BYTES, "send less, like calibrations by name")


def _limited(request: Request, limit: int, advice: str) -> Request:
    """Limit a request's body to so many bytes, and refuse one that is compressed.

    advice: what to do with a larger one. Raises UnsupportedMediaError, UploadTooLargeError.
    """
    if request.headers.get("content-encoding", "identity").strip().lower() != "identity":
        raise UnsupportedMediaError("Send the body as it is, without a Content-Encoding.")
    too_large = UploadTooLargeError(
        f"The request is larger than {limit:,} bytes, which is all this service takes: {advice}."
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


def _named(
    body: bytes,
    directory: Path,
    taken: type[CaptureRequest | CalibrationCaptureRequest],
    sent: type[UploadsRequest | CalibrationRequest],
) -> Intake:
    """Read a request that names its pair; taken: its model where a camera takes it, else sent."""
    values, body, named = _json(body)
    _check_source(values)
    uploads = isinstance(values, dict) and "uploads" in values
    with in_words():
        wanted = (sent if uploads else taken).model_validate_json(_kept(body), strict=True)
    intake = Intake(wanted.options, handling_of(wanted), directory, calibrations=named)
    if isinstance(wanted, UploadsRequest | CalibrationRequest):
        return replace(intake, uploads=wanted.uploads.model_dump())
    drivers.check_address(wanted.capture.camera)
    return replace(intake, capture=wanted.capture)


def _check_source(values: Any) -> None:
    if isinstance(values, dict) and values.keys().isdisjoint(("capture", "uploads")):
        raise OptionError(
            "Name the pair: `uploads` for photographs that are sent, or `capture` for a camera."
        )


def _json(body: bytes) -> tuple[Any, bytes, dict[str, Any]]:
    try:
        values = json.loads(body)
    except (ValueError, RecursionError):  # told where it is read
        return None, body, {}
    named: dict[str, Any] = {}
    if isinstance(values, dict) and "options" in values:
        values["options"], named = take_out(values["options"])
        body = json.dumps(values).encode()
    return values, body, named


def handling_of(wanted: Handling) -> Handling:
    """Take out of a request how its job is to be dealt with."""
    return Handling.model_validate(
        wanted.model_dump(include=set(Handling.model_fields), exclude_unset=True)
    )


def _pair(form: Form, directory: Path) -> Intake:
    return _sent(form, form.texts.get("options", "{}"), Options.model_validate_json, directory)


def _calibration_pair(form: Form, directory: Path) -> Intake:
    if not form.texts.get("options"):
        raise MalformedRequestError("The part options is missing; it says what to calibrate.")
    return _sent(form, form.texts["options"], CALIBRATION_OPTIONS.validate_json, directory)


def _sent(form: Form, text: str, options_of: Callable[..., AnyOptions], directory: Path) -> Intake:
    text, named = _taken_out(text)
    with in_words("handling"):
        handled = _kept(form.texts.get("handling", "{}"))
        handling = Handling.model_validate_json(handled, strict=True)
    with in_words("options"):
        options = options_of(_kept(text), strict=True)
    return Intake(options, handling, directory, sha256=form.sha256, calibrations=named)


def _taken_out(text: str) -> tuple[str, dict[str, Any]]:
    try:
        options, named = take_out(json.loads(text))
        return json.dumps(options), named
    except (ValueError, RecursionError):
        return text, {}  # what is wrong with it is told where it is read


def _kept(text: AnyStr) -> AnyStr:
    """Give JSON as it is, if all databases can keep it. Raises OptionError."""
    if _NUL.search(text if isinstance(text, str) else text.decode(errors="replace")):
        raise OptionError("A text holds a NUL (\\u0000), which cannot be kept: leave it out.")
    return text
