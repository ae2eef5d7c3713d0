"""Holds every answer that a test gets to what the OpenAPI document says of its route."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import httpx
from fastapi import FastAPI

Operations = dict[tuple[str, re.Pattern[str]], dict[str, Any]]
"""Answers by status, for each method and pattern of a path."""

_PROBLEM = "application/problem+json"


@cache
def described(app: FastAPI) -> Operations:
    """What the document of an app says of its routes."""
    return {
        (method.upper(), re.compile(re.sub(r"\\?{[^/]+?}", "[^/]+", re.escape(path)))): operation[
            "responses"
        ]
        for path, operations in app.openapi()["paths"].items()
        for method, operation in operations.items()
    }


def check_described(operations: Operations, answer: httpx.Response) -> None:
    """Fail on a status, a type or a kind of problem that the document does not name."""
    method, path = answer.request.method, answer.request.url.path
    responses = next(
        (
            responses
            for (verb, pattern), responses in operations.items()
            if verb == method and pattern.fullmatch(path)
        ),
        None,
    )
    if responses is None:  # no route, or one that the document leaves out
        return
    where = f"{method} {path}: {answer.status_code}"
    told = responses.get(str(answer.status_code))
    assert told is not None, f"{where} is not in the document"
    if "content" not in told or method == "HEAD":  # which has no body
        return
    media_type = answer.headers.get("content-type", "").partition(";")[0]
    assert {media_type, "*/*"} & set(told["content"]), f"{where} is {media_type}"
    if media_type == _PROBLEM:
        answer.read()
        kind = answer.json()["type"].rpartition(":")[2]
        assert kind in told["content"][_PROBLEM]["examples"], f"{where} may not be {kind}"
