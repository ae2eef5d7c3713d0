"""HTTP/1.1 connections that end when nothing comes of them."""

from __future__ import annotations

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_SECONDS = 20.0
"""How long the head of a request may take, from the first byte or the connection's beginning."""

_READ_BYTES = 64 * 1024
_REST_SECONDS = 300.0
"""How long the rest of a request that was answered already may take."""


class PatientProtocol(H11Protocol):
    """uvicorn's protocol, which by itself waits for the head of a request for ever."""

    _end: asyncio.TimerHandle | None = None
    head_seconds = HEAD_SECONDS

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first head."""
        super().connection_made(transport)
        # asyncio reads 256 KiB at a time, of which several are held for each upload on its way.
        transport.max_size = _READ_BYTES  # type: ignore[attr-defined]
        self._end = self.loop.call_later(self.head_seconds, transport.abort)

    def data_received(self, data: bytes) -> None:
        """Wait for the rest of a head that has begun; not for what a route reads."""
        super().data_received(data)
        answering = self.cycle is not None and not self.cycle.response_complete
        if answering:
            self._stop_waiting()
        elif self._end is None:
            idle = self.conn.their_state is h11.IDLE
            seconds = self.head_seconds if idle else _REST_SECONDS
            self._end = self.loop.call_later(seconds, self.transport.abort)

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        self._stop_waiting()
        super().connection_lost(exc)

    def on_response_complete(self) -> Any:
        """Leave the time until the next request to uvicorn's keep-alive."""
        self._stop_waiting()
        super().on_response_complete()

    def _stop_waiting(self) -> None:
        if self._end is not None:
            self._end.cancel()
            self._end = None
