"""Gives every request an id that names it in answers, logs, jobs and traces."""

from __future__ import annotations

import uuid

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Receive, Scope, Send

from service import tracing
from service.api.headers import with_headers


class TraceIds:
    """Gives every request a trace_id, the caller's own when it sends W3C `traceparent`."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        traceparent = dict(scope["headers"]).get(b"traceparent", b"").decode("latin-1")
        trace_id = tracing.trace_id(traceparent) or uuid.uuid4().hex
        scope.setdefault("state", {})["trace_id"] = trace_id

        def add(headers: MutableHeaders) -> None:
            headers.append("Trace-Id", trace_id)

        await self._app(scope, receive, with_headers(send, add))
