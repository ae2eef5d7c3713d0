"""What of tus 1.0 (https://tus.io/protocols/resumable-upload) all requests for uploads share.

Spoken are the core and the extensions creation, creation-with-upload, expiration, checksum and
termination.
"""

from __future__ import annotations

import base64
import binascii
import re
from typing import Annotated, Any

from fastapi import Header
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Receive, Scope, Send

from service.api.headers import with_headers
from service.api.receiving import ALGORITHMS, Checksum
from service.errors import MalformedRequestError, TusVersionError

VERSION = "1.0.0"
EXTENSIONS = "creation,creation-with-upload,expiration,checksum,termination"
PIECE = "application/offset+octet-stream"
"""The media type of a piece."""

_METADATA_CHARACTERS = 4096  # told again as they came, as tus asks; nothing here reads them
_NUMBER = re.compile(r"[0-9]{1,15}")


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


def check_version(
    tus_resumable: Annotated[str | None, Header(description=f"Must be {VERSION}.")] = None,
) -> None:
    """Accept requests of clients of this version alone. Raises TusVersionError."""
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


def read_number(header: str, text: str) -> int:
    """Read a number of bytes. Raises MalformedRequestError, which names the header."""
    if not _NUMBER.fullmatch(text):
        raise MalformedRequestError(f"{header} must be a number of bytes.")
    return int(text)


def check_metadata(header: str | None) -> str | None:
    """Give the header Upload-Metadata, if it may be kept. Raises MalformedRequestError."""
    if header and (len(header) > _METADATA_CHARACTERS or not re.fullmatch("[ -~]*", header)):
        raise MalformedRequestError(
            f"Upload-Metadata must be ASCII text of up to {_METADATA_CHARACTERS} characters."
        )
    return header


def read_checksum(header: str | None) -> Checksum | None:
    """Read the header Upload-Checksum; None without one. Raises MalformedRequestError."""
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
