"""Limits on requests: how many at a time, and how long one may pause."""

from __future__ import annotations

import asyncio

from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.problems import answer_of
from service.errors import BusyError, SlowRequestError, UnreadyError
from service.settings import Settings

_ALWAYS = "/healthz"


class Limits:
    """Refuses requests beyond a number, and ends those whose body stops coming.

    A request that a stop of the service cuts off is answered so, unless its answer has begun.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._running = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        settings: Settings = scope["app"].state.context.settings
        if self._running >= settings.requests and scope["path"] != _ALWAYS:
            busy = BusyError(f"{self._running} requests are being answered; send it again shortly.")
            await answer_of(busy, Request(scope))(scope, receive, send)
            return
        begun = False

        async def send_on(message: Message) -> None:
            nonlocal begun
            begun = True
            await send(message)

        self._running += 1
        try:
            await self._app(scope, _hurried(receive, settings.pause_seconds), send_on)
        except asyncio.CancelledError:  # it took longer than a service that stops waits for it
            if not begun:
                cut = UnreadyError("The service has stopped meanwhile; send it again.")
                await answer_of(cut, Request(scope))(scope, receive, send)
        finally:
            self._running -= 1


def _hurried(receive: Receive, seconds: float) -> Receive:
    """Receive with a limit on every wait, until the body is complete."""
    complete = False

    async def receive_soon() -> Message:
        nonlocal complete
        if complete:  # who still waits, waits for the client to leave
            return await receive()
        try:
            message = await asyncio.wait_for(receive(), seconds)
        except TimeoutError:
            raise SlowRequestError(
                f"Nothing of the request has come for {seconds:g} s; send it again."
            ) from None
        complete = not message.get("more_body", False)
        return message

    return receive_soon
