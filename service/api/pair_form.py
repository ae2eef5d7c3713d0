"""What the routes that take a pair of photographs say of themselves in the OpenAPI document."""

from __future__ import annotations

import re
from typing import Annotated, Any

from fastapi import Header
from pydantic import AfterValidator, Field

from pipeline import errors as pipeline_errors
from service.api.problems import responses
from service.errors import (
    IdempotencyError,
    MalformedRequestError,
    NotReadyError,
    QueueFullError,
    QuotaError,
    SlowRequestError,
    StorageFullError,
    StoredQuotaError,
    UnfinishedUploadError,
    UnreadyError,
    UnsupportedMediaError,
    UploadTooLargeError,
)
from service.frames import FRAMES

_KEY = "[!-~]{1,255}"


def _check_key(key: str) -> str:
    if not re.fullmatch(_KEY, key):
        raise ValueError("use 1 to 255 visible ASCII characters without spaces, such as a UUID")
    return key


IdempotencyKey = Annotated[
    Annotated[str, AfterValidator(_check_key), Field(json_schema_extra={"pattern": f"^{_KEY}$"})]
    | None,
    Header(
        description="Any text without spaces that no other request bears, such as a UUID: the same "
        "request sent again gives the same job, for as long as the job is kept.",
    ),
]

_TEXT = {"schema": {"type": "string"}}
_REPLAYED = {
    "description": "true: an earlier request with this Idempotency-Key made the job.",
    **_TEXT,
}
_FILE = {"type": "string", "format": "binary"}


def pair_form(options: dict[str, Any], told: str, required: bool = False) -> dict[str, Any]:
    """Describe the form with a pair, an entry of a body's content.

    options: schema of that part. told: what it is. required: whether it has to be there.
    """
    properties = {
        "no_flash": {
            **_FILE,
            "description": "The photograph without the flash, in any format we read.",
        },
        "flash": {**_FILE, "description": "The photograph with the flash."},
        "options": {
            "type": "string",
            "contentMediaType": "application/json",
            "contentSchema": options,
            "description": told,
        },
        "handling": {
            "type": "string",
            "contentMediaType": "application/json",
            "contentSchema": {"$ref": "#/components/schemas/Handling"},
            "description": "Priority, deadline and webhook, as JSON text.",
        },
    }
    parts = [*FRAMES, "options"] if required else list(FRAMES)
    schema = {"type": "object", "required": parts, "properties": properties}
    return {"multipart/form-data": {"schema": schema}}


def accepted(
    *errors: type[Exception], headers: dict[str, Any] | None = None
) -> dict[int | str, Any]:
    """Describe the answers of a route that makes a job of a pair.

    errors: its own problems. headers: its own headers.
    """
    usual = {"Location": _TEXT, "Idempotency-Replayed": _REPLAYED}
    return {
        202: {"headers": usual | (headers or {})},
        **responses(
            MalformedRequestError,
            UploadTooLargeError,
            UnsupportedMediaError,
            UnfinishedUploadError,
            NotReadyError,  # a calibration that the options name
            pipeline_errors.ImageTooLargeError,
            pipeline_errors.UnreadableImageError,
            pipeline_errors.PairMismatchError,
            pipeline_errors.UnusablePairError,
            pipeline_errors.OptionError,
            IdempotencyError,
            QueueFullError,
            QuotaError,
            SlowRequestError,
            StoredQuotaError,
            StorageFullError,
            UnreadyError,
            *errors,
            status=(503,),
        ),
    }
