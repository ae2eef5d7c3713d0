"""Routes of uploads that may break off and go on, by tus: see service.api.tus."""

from __future__ import annotations

import uuid
from email.utils import formatdate
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Request, Response
from fastapi.concurrency import run_in_threadpool

from service import upload_pieces
from service.api.callers import Caller, Calling
from service.api.context import Context, Parts
from service.api.problems import responses
from service.api.receiving import ALGORITHMS, receive
from service.api.tus import (
    EXTENSIONS,
    PIECE,
    check_metadata,
    check_version,
    read_checksum,
    read_number,
)
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

_INTEGER = {"schema": {"type": "integer"}}
_TEXT = {"schema": {"type": "string"}}
_HEADERS: dict[str, Any] = {
    "Tus-Resumable": _TEXT,
    "Upload-Offset": {**_INTEGER, "description": "The byte at which the upload goes on."},
    "Upload-Expires": {**_TEXT, "description": "When the upload is removed, unless it goes on."},
}
_BODY = {"content": {PIECE: {"schema": {"type": "string", "format": "binary"}}}}


router = APIRouter(tags=["uploads"])
_tus = [Depends(check_version)]
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
            "Tus-Extension": EXTENSIONS,
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
    length = read_number("Upload-Length", upload_length)
    limit = context.settings.upload_bytes
    if length > limit:
        raise UploadTooLargeError(
            f"The upload has {length:,} bytes, and this service takes {limit:,}: send a smaller "
            "photograph, or have its operator raise LIGHTLAYERS_UPLOAD_BYTES."
        )
    metadata = check_metadata(upload_metadata)
    checksum = read_checksum(upload_checksum)
    upload = await run_in_threadpool(_create, context, caller, length, metadata)
    if content_type == PIECE:
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
    if content_type != PIECE:
        raise UnsupportedMediaError(f"Send the piece as {PIECE}.")
    offset, checksum = read_number("Upload-Offset", upload_offset), read_checksum(upload_checksum)
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
    upload_pieces.delete(context.storage, upload_id)
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
