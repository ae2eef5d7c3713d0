"""Headers of every answer that tell browsers to do nothing with it that nobody asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

DEFAULTS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""A route that needs another value sends that."""

_STRICT_TRANSPORT = "max-age=31536000"

_FRAMINGS = {b"content-length", b"transfer-encoding"}
"""A request with both may end elsewhere for a proxy than for us: what follows it is then not to be
answered as another request (RFC 9112, section 6.1)."""

METHODS = ["GET", "HEAD", "POST", "PATCH", "DELETE"]
SENT = [
    "Authorization",
    "Content-Type",
    "Idempotency-Key",
    "If-None-Match",
    "If-Range",
    "Last-Event-ID",
    "Prefer",
    "Range",
    "traceparent",
    "Tus-Resumable",
    "Upload-Checksum",
    "Upload-Length",
    "Upload-Metadata",
    "Upload-Offset",
    "X-HTTP-Method-Override",
]
SHOWN = [
    "Content-Range",
    "ETag",
    "Idempotency-Replayed",
    "Location",
    "Preference-Applied",
    "Retry-After",
    "Trace-Id",
    "Tus-Resumable",
    "Upload-Expires",
    "Upload-Length",
    "Upload-Offset",
]
"""What pages of the origins that LIGHTLAYERS_ORIGINS names may use, send and read (CORS)."""


class SafeHeaders:
    """Adds the defaults to every answer that has none of its own."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        def add(headers: MutableHeaders) -> None:
            for name, value in _defaults(scope):
                headers.setdefault(name, value)

        await self._app(scope, receive, with_headers(send, add))


def with_headers(send: Send, add: Callable[[MutableHeaders], None]) -> Send:
    """Send an answer after `add` has changed its headers."""

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            add(MutableHeaders(scope=message))
        await send(message)

    return send_with_headers


def _defaults(scope: Scope) -> Iterable[tuple[str, str]]:
    yield from DEFAULTS.items()
    if scope["scheme"] == "https":
        yield "Strict-Transport-Security", _STRICT_TRANSPORT
    if _FRAMINGS.issubset(name for name, _ in scope["headers"]):
        yield "Connection", "close"
