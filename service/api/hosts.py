"""Refuses requests that a browser was tricked into sending to a service on loopback."""

from __future__ import annotations

import re

from fastapi import Request

from service.addresses import is_loopback
from service.api.context import Parts
from service.errors import ForeignHostError, ForeignOriginError
from service.settings import Settings

_OF_PROXIES = ("forwarded", "via", "x-forwarded-for", "x-forwarded-host", "x-real-ip")

_HOST = re.compile(r"([a-z0-9._-]+|\[[0-9a-f:.]+\])(?::([0-9]{1,5}))?")
"""A Host header in lower case: a name or an address, and a port."""


async def check_host(request: Request, context: Parts) -> None:
    """Accept only this machine's own names where the service listens on loopback.

    A web site may point its name at 127.0.0.1 and so read what a local service answers (DNS
    rebinding); the Host header gives it away. Raises ForeignHostError.
    """
    if is_loopback(context.settings.host) and not is_loopback(_name_of(_asked_of(request))):
        raise ForeignHostError(
            f"This service listens on {context.settings.host} only and answers to no other name; "
            "ask for it as http://localhost, or start it with another host."
        )


def check_origin(request: Request, settings: Settings) -> None:
    """Accept no request of another site's page, which browsers send even if it may not read.

    Only for requests without a key: no browser adds that by itself. Raises ForeignOriginError.
    """
    origin = request.headers.get("origin")
    own = f"{request.url.scheme}://{_asked_of(request)}"
    if origin is not None and origin.lower() not in (own, *settings.origins.split()):
        raise ForeignOriginError(
            "This service takes no requests from pages of other sites; LIGHTLAYERS_ORIGINS can "
            "name those that may ask."
        )


def _asked_of(request: Request) -> str:
    """The Host header in lower case, "" unless there is just one.

    Not that of request.url, which has the service's own address where the header is malformed.
    """
    sent = request.headers.getlist("host")
    return sent[0].strip().lower() if len(sent) == 1 else ""


def _name_of(host: str) -> str:
    """The name or address in a Host header, "" where it is malformed."""
    found = _HOST.fullmatch(host)
    return found[1] if found and int(found[2] or 0) < 2**16 else ""


def came_through_proxy(request: Request) -> bool:
    """Whether a proxy passed the request on, so that it may come from anywhere."""
    return any(name in request.headers for name in _OF_PROXIES)
