"""What the OpenAPI document says of routes that take a pair of photographs."""

from __future__ import annotations

from typing import Any

from pipeline.errors import (
    ImageTooLargeError,
    PairMismatchError,
    UnreadableImageError,
    UnusablePairError,
)
from service.errors import NoProcessError, UnfinishedUploadError, UnreadyError
from service.frames import FRAMES

PROBLEMS = (
    ImageTooLargeError,
    PairMismatchError,
    UnreadableImageError,
    UnusablePairError,
    UnfinishedUploadError,
    UnreadyError,
    NoProcessError,
)
"""What a pair may be refused for."""

_FILE = {"type": "string", "format": "binary"}


def describe(options: dict[str, Any], told: str, required: bool = False) -> dict[str, Any]:
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
