"""Refuses requests that a browser was tricked into sending to a service on loopback."""

from __future__ import annotations

import ipaddress

from fastapi import Request

from service.api.context import Parts
from service.errors import ForeignHostError, ForeignOriginError
from service.settings import Settings

_OF_PROXIES = ("forwarded", "via", "x-forwarded-for", "x-forwarded-host", "x-real-ip")


async def check_host(request: Request, context: Parts) -> None:
    """Accept only this machine's own names where the service listens on loopback.

    A web site may point its name at 127.0.0.1 and so read what a local service answers (DNS
    rebinding); the Host header gives it away. Raises ForeignHostError.
    """
    host = request.url.hostname or ""
    if is_loopback(context.settings.host) and not is_loopback(host):
        raise ForeignHostError(
            f"This service listens on {context.settings.host} only and answers to no other name; "
            "ask for it as http://localhost, or start it with another host."
        )


def check_origin(request: Request, settings: Settings) -> None:
    """Accept no request of another site's page, which browsers send even if it may not read.

    Only for requests without a key: no browser adds that by itself. Raises ForeignOriginError.
    """
    origin = request.headers.get("origin")
    own = f"{request.url.scheme}://{request.url.netloc}"
    if origin is not None and origin.lower() not in (own.lower(), *settings.origins.split()):
        raise ForeignOriginError(
            "This service takes no requests from pages of other sites; LIGHTLAYERS_ORIGINS can "
            "name those that may ask."
        )


def came_through_proxy(request: Request) -> bool:
    """Whether a proxy passed the request on, so that it may come from anywhere."""
    return any(name in request.headers for name in _OF_PROXIES)


def is_loopback(name: str) -> bool:
    """Whether a name or address without port means this machine alone."""
    try:
        return ipaddress.ip_address(name.strip("[]")).is_loopback
    except ValueError:
        return name == "localhost" or name.endswith(".localhost")
