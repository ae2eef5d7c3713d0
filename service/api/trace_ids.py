"""Gives every request an id that names it in answers, logs, jobs and traces."""

from __future__ import annotations

import uuid

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service import tracing


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

        async def send_with_id(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], (b"trace-id", trace_id.encode())]
            await send(message)

        await self._app(scope, receive, send_with_id)
