"""Refuses requests that a browser was tricked into sending to a service on loopback."""

from __future__ import annotations

import ipaddress

from fastapi import Request

from service.api.context import Parts
from service.errors import ForeignHostError


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


def is_loopback(name: str) -> bool:
    """Whether a name or address without port means this machine alone."""
    try:
        return ipaddress.ip_address(name.strip("[]")).is_loopback
    except ValueError:
        return name == "localhost" or name.endswith(".localhost")
