"""Answers that are streams of server-sent events."""

from __future__ import annotations

from collections.abc import AsyncIterator

from fastapi.sse import EventSourceResponse, format_sse_event

KEEP_ALIVE_SECONDS = 15.0
"""After so much silence a stream says that it goes on, or proxies would end it."""

RETRY = format_sse_event(retry=2000)
"""The first event of each: after how many milliseconds a browser comes again when it breaks off."""


def stream_events(events: AsyncIterator[bytes]) -> EventSourceResponse:
    """Make the answer that hands events on as they come."""
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return EventSourceResponse(events, headers=headers)
