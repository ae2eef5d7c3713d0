"""Refuses query parameters that a route does not have: a mistyped one would change nothing."""

from __future__ import annotations

from fastapi import Request
from fastapi.exceptions import RequestValidationError


async def check_query(request: Request) -> None:
    """Accept the parameters alone that the route declares. Raises RequestValidationError."""
    known = [field.alias for field in request.scope["route"].dependant.query_params]
    for name in request.query_params:
        if name not in known:
            *most, last = known or ["none"]
            those = f"{', '.join(most)} and {last}" if most else last
            told = f"there is no parameter {name[:32]!r}; this address takes {those}"
            raise RequestValidationError([{"type": "unknown", "loc": ("query",), "msg": told}])
