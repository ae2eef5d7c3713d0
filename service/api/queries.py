"""Refuses query parameters that would change nothing: mistyped ones, and those given twice."""

from __future__ import annotations

from fastapi import Request
from fastapi.exceptions import RequestValidationError


async def check_query(request: Request) -> None:
    """Accept only parameters that the route declares, each once. Raises RequestValidationError."""
    known = [field.alias for field in request.scope["route"].dependant.query_params]
    for name in request.query_params:
        if name not in known:
            *most, last = known or ["none"]
            those = f"{', '.join(most)} and {last}" if most else last
            told = f"there is no parameter {name[:32]!r}; this address takes {those}"
            raise RequestValidationError([{"type": "unknown", "loc": ("query",), "msg": told}])
        if len(request.query_params.getlist(name)) > 1:
            told = "it is there more than once; give it once"
            raise RequestValidationError([{"type": "twice", "loc": ("query", name), "msg": told}])
