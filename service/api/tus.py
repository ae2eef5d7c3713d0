"""Routes of uploads that may break off and go on: tus 1.0 (https://tus.io/protocols/resumable-upload).

Spoken are the core and the extensions creation, creation-with-upload, expiration, checksum and
termination.
"""

from __future__ import annotations

import base64
import binascii
import re
import uuid
from email.utils import formatdate
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Request, Response
from fastapi.concurrency import run_in_threadpool
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Receive, Scope, Send

from service.api.callers import Caller, Calling
from service.api.context import Context, Parts
from service.api.headers import with_headers
from service.api.problems import responses
from service.api.receiving import ALGORITHMS, Checksum, receive
from service.errors import (
    ChecksumError,
    ExpiredUploadError,
    MalformedRequestError,
    OffsetError,
    QueueFullError,
    QuotaError,
    SlowRequestError,
    StorageFullError,
    StoredQuotaError,
    TusVersionError,
    UnknownUploadError,
    UnsupportedMediaError,
    UploadTooLargeError,
)
from service.room import check_disk, check_room
from service.rows import quotas, uploads
from service.rows.uploads import Upload

VERSION = "1.0.0"
_EXTENSIONS = "creation,creation-with-upload,expiration,checksum,termination"
_PIECE = "application/offset+octet-stream"
_METADATA_CHARACTERS = 4096  # told again as they came, as tus asks; nothing here reads them
_NUMBER = re.compile(r"[0-9]{1,15}")

_INTEGER = {"schema": {"type": "integer"}}
_TEXT = {"schema": {"type": "string"}}
_HEADERS: dict[str, Any] = {
    "Tus-Resumable": _TEXT,
    "Upload-Offset": {**_INTEGER, "description": "The byte at which the upload goes on."},
    "Upload-Expires": {**_TEXT, "description": "When the upload is removed, unless it goes on."},
}
_BODY = {"content": {_PIECE: {"schema": {"type": "string", "format": "binary"}}}}


class Tus:
    """Gives what every request and answer of tus has; an ASGI middleware."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or not re.match("/uploads(/|$)", scope["path"]):
            await self._app(scope, receive, send)
            return
        # For clients whose network knows no PATCH.
        override = dict(scope["headers"]).get(b"x-http-method-override", b"").decode("latin-1")
        if scope["method"] == "POST" and override:
            scope["method"] = override.upper()

        def add(headers: MutableHeaders) -> None:
            headers.append("Tus-Resumable", VERSION)
            headers.append("Tus-Version", VERSION)

        await self._app(scope, receive, with_headers(send, add))


def _check_version(
    tus_resumable: Annotated[str | None, Header(description=f"Must be {VERSION}.")] = None,
) -> None:
    if tus_resumable != VERSION:
        raise TusVersionError(f"Send the header Tus-Resumable: {VERSION}, as clients of tus do.")


def describe(paths: dict[str, Any]) -> None:
    """Say in the OpenAPI document that the header of the version is needed.

    It is no such parameter of the routes, as what is missing is answered with 412 by tus.
    """
    for operations in paths.values():
        for operation in operations.values():
            for parameter in operation.get("parameters", []):
                if parameter["name"] == "tus-resumable":
                    parameter |= {"required": True, "schema": {"type": "string", "enum": [VERSION]}}


router = APIRouter(tags=["uploads"])
_tus = [Depends(_check_version)]
Offset = Annotated[str, Header(description="The byte at which this piece begins.")]
UploadChecksum = Annotated[
    str | None, Header(description=f"Algorithm ({', '.join(ALGORITHMS)}) and base64 of the digest.")
]
ContentType = Annotated[str | None, Header(include_in_schema=False)]


@router.options("/uploads", status_code=204)
@router.options("/uploads/{upload_id}", status_code=204, include_in_schema=False)
def describe_uploads(context: Parts) -> Response:
    """Tell what of tus is spoken here, and how large an upload may be."""
    return Response(
        status_code=204,
        headers={
            "Tus-Extension": _EXTENSIONS,
            "Tus-Max-Size": str(context.settings.upload_bytes),
            "Tus-Checksum-Algorithm": ",".join(ALGORITHMS),
        },
    )


@router.post(
    "/uploads",
    status_code=201,
    dependencies=_tus,
    response_class=Response,
    openapi_extra={"requestBody": _BODY},
    responses={
        201: {"description": "The upload.", "headers": {"Location": _TEXT, **_HEADERS}},
        **responses(
            MalformedRequestError,
            OffsetError,
            TusVersionError,
            UploadTooLargeError,
            UnsupportedMediaError,
            ChecksumError,
            SlowRequestError,
            QueueFullError,
            QuotaError,
            StorageFullError,
            StoredQuotaError,
            status=(422, 503),
        ),
    },
)
async def create_upload(
    request: Request,
    context: Parts,
    caller: Calling,
    upload_length: Annotated[str, Header(description="Bytes of the whole photograph.")],
    upload_metadata: Annotated[str | None, Header()] = None,
    upload_checksum: UploadChecksum = None,
    content_type: ContentType = None,
) -> Response:
    """Begin to upload a photograph piece by piece; a job may name it once all of it has come."""
    length = _number("Upload-Length", upload_length)
    limit = context.settings.upload_bytes
    if length > limit:
        raise UploadTooLargeError(
            f"The upload has {length:,} bytes, and this service takes {limit:,}: send a smaller "
            "photograph, or have its operator raise LIGHTLAYERS_UPLOAD_BYTES."
        )
    metadata = _metadata(upload_metadata)
    checksum = _checksum(upload_checksum)
    upload = await run_in_threadpool(_create, context, caller, length, metadata)
    if content_type == _PIECE:
        try:
            _check_announced(request, upload)
            upload = await receive(request, context, upload, checksum)
        except Exception:  # without an answer that names it, nobody can go on with it
            await context.store(_remove, context, caller, upload.id)
            raise
    return Response(
        status_code=201, headers={"Location": f"/uploads/{upload.id}", **_state(upload)}
    )


@router.head(
    "/uploads/{upload_id}",
    dependencies=_tus,
    response_class=Response,
    responses={
        200: {"description": "Where it goes on.", "headers": _HEADERS},
        **responses(UnknownUploadError, ExpiredUploadError, TusVersionError, status=(503,)),
    },
)
def get_upload(context: Parts, caller: Calling, upload_id: str) -> Response:
    """Tell where an upload goes on."""
    upload = _find(context, caller, upload_id)
    told = {"Upload-Length": str(upload.length), "Cache-Control": "no-store"}
    if upload.metadata:
        told["Upload-Metadata"] = upload.metadata
    return Response(headers={**told, **_state(upload)})


@router.patch(
    "/uploads/{upload_id}",
    status_code=204,
    dependencies=_tus,
    response_class=Response,
    openapi_extra={"requestBody": {"required": True, **_BODY}},
    responses={
        204: {"description": "The piece is stored.", "headers": _HEADERS},
        **responses(
            MalformedRequestError,
            UnknownUploadError,
            ExpiredUploadError,
            OffsetError,
            TusVersionError,
            UploadTooLargeError,
            UnsupportedMediaError,
            ChecksumError,
            SlowRequestError,
            StorageFullError,
            status=(422, 503),
        ),
    },
)
async def append_to_upload(
    request: Request,
    context: Parts,
    caller: Calling,
    upload_id: str,
    upload_offset: Offset,
    upload_checksum: UploadChecksum = None,
    content_type: ContentType = None,
) -> Response:
    """Send the next piece of an upload; what has come stays, even where the connection breaks."""
    if content_type != _PIECE:
        raise UnsupportedMediaError(f"Send the piece as {_PIECE}.")
    offset, checksum = _number("Upload-Offset", upload_offset), _checksum(upload_checksum)
    await run_in_threadpool(check_disk, context.settings, context.storage)
    upload = await run_in_threadpool(_find, context, caller, upload_id)
    if offset != upload.received:
        raise OffsetError(
            f"The upload goes on at byte {upload.received}, and this piece begins at {offset}."
        )
    _check_announced(request, upload)
    upload = await receive(request, context, upload, checksum)
    return Response(status_code=204, headers=_state(upload))


@router.delete(
    "/uploads/{upload_id}",
    status_code=204,
    dependencies=_tus,
    response_class=Response,
    responses=responses(UnknownUploadError, TusVersionError, status=(503,)),
)
async def delete_upload(context: Parts, caller: Calling, upload_id: str) -> Response:
    """Remove an upload."""
    if not await context.store(_remove, context, caller, upload_id):
        raise _unknown(upload_id)
    return Response(status_code=204)


def _create(context: Context, caller: Caller, length: int, metadata: str | None) -> Upload:
    # It is good for a job alone: where there is no room for one, that is told before it comes.
    check_room(context.engine, context.settings, context.storage, caller.owner)
    upload_id = uuid.uuid4().hex
    values = {"id": upload_id, "owner": caller.owner, "length": length, "metadata": metadata}
    with context.engine.begin() as connection:
        uploads.add(connection, values, context.settings.upload_seconds)
        quotas.charge_upload(connection, caller.owner)
    return _find(context, caller, upload_id)


def _remove(context: Context, caller: Caller, upload_id: str) -> bool:
    """Delete row and pieces of an upload; false when it is not there (any more)."""
    with context.engine.begin() as connection:
        if not uploads.remove(connection, caller.owner, [upload_id]):
            return False
    uploads.delete_parts(context.storage, upload_id)
    return True


def _find(context: Context, caller: Caller, upload_id: str) -> Upload:
    with context.engine.connect() as connection:
        upload = uploads.find(connection, caller.owner, upload_id)
    if upload is None:
        raise _unknown(upload_id)
    if upload.expired:
        raise ExpiredUploadError("The upload was not gone on with in time; begin another.")
    return upload


def _unknown(upload_id: str) -> UnknownUploadError:
    return UnknownUploadError(
        f"There is no upload {upload_id[:32]!r}; it may have expired, or a job may have used it."
    )


def _state(upload: Upload) -> dict[str, str]:
    return {
        "Upload-Offset": str(upload.received),
        "Upload-Expires": formatdate(upload.expires, usegmt=True),
    }


def _check_announced(request: Request, upload: Upload) -> None:
    announced = request.headers.get("content-length", "0")
    rest = upload.length - upload.received
    if announced.isdecimal() and int(announced) > rest:
        raise UploadTooLargeError(
            f"This piece has {int(announced):,} bytes; {rest:,} of the upload are to come."
        )


def _number(header: str, text: str) -> int:
    if not _NUMBER.fullmatch(text):
        raise MalformedRequestError(f"{header} must be a number of bytes.")
    return int(text)


def _metadata(header: str | None) -> str | None:
    if header and (len(header) > _METADATA_CHARACTERS or not re.fullmatch("[ -~]*", header)):
        raise MalformedRequestError(
            f"Upload-Metadata must be ASCII text of up to {_METADATA_CHARACTERS} characters."
        )
    return header


def _checksum(header: str | None) -> Checksum | None:
    if header is None:
        return None
    algorithm, _, encoded = header.partition(" ")
    try:
        digest = base64.b64decode(encoded, validate=True)
    except (binascii.Error, ValueError):
        digest = b""
    if algorithm not in ALGORITHMS or not digest:
        raise MalformedRequestError(
            f"Upload-Checksum must be one of {', '.join(ALGORITHMS)}, a space and base64."
        )
    return Checksum(algorithm, digest)
