"""Turns every exception of a request into a problem (RFC 9457)."""

from __future__ import annotations

import logging
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import Match

from service import metrics
from service.api.headers import DEFAULTS, METHODS
from service.durable import FULL
from service.errors import (
    BusyError,
    EndedError,
    ForbiddenError,
    ForeignHostError,
    ForeignOriginError,
    MalformedRequestError,
    NotReadyError,
    QueueFullError,
    QuotaError,
    RangeError,
    SlowRequestError,
    StorageFullError,
    UnauthorizedError,
    UnreadyError,
)
from service.problems import (
    DATABASE_AWAY,
    INTERNAL,
    INVALID,
    KINDS,
    STORE_AWAY,
    Kind,
    Problem,
    cause_of,
    kind_of,
    make_problem,
    problem_of,
)
from service.sentences import sentence_of_faults
from service.workers.sandbox import TaskError

MEDIA_TYPE = "application/problem+json"
RETRY_SECONDS = 10

_ADMITTED = (503, 507)
"""Statuses of 500 and more that a request may be answered with."""

_TRACE = "4bf92f3577b34da6a3ce929d0e0e4736"
"""Of examples."""

log = logging.getLogger("service.api")


def responses(*errors: type[Exception], status: tuple[int, ...] = ()) -> dict[int | str, Any]:
    """Write the OpenAPI entry of the problems a route answers with.

    errors: those that it raises; NotReadyError brings EndedError along. status: of others, which
    any route may meet.
    """
    also = (EndedError,) if NotReadyError in errors else ()
    own = [KINDS[error] for error in (*errors, *also)]
    statuses = sorted({*(kind.status for kind in own), *status})
    return {
        code: _describe([kind for kind in (*own, *_ANYWHERE) if kind.status == code])
        for code in statuses
    }


_ANYWHERE = (
    *(KINDS[error] for error in (UnauthorizedError, ForbiddenError, ForeignOriginError)),
    *(KINDS[error] for error in (ForeignHostError, BusyError)),
    INVALID,
    STORE_AWAY,
    DATABASE_AWAY,
)
"""Kinds that any route may answer with, beside its own of the same status."""


def _describe(kinds: list[Kind]) -> dict[str, Any]:
    names = sorted({kind.name for kind in kinds})
    schema = {"$ref": "#/components/schemas/Problem"}
    examples = {name: {"$ref": f"#/components/examples/{name}"} for name in names}
    return {
        "description": f"A problem: {', '.join(names)}.",
        "content": {MEDIA_TYPE: {"schema": schema, "examples": examples}},
    }


def examples() -> dict[str, Any]:
    """Make an example of each kind of problem, for the OpenAPI document, by the kind's name."""
    return {
        kind.name: {
            "value": make_problem(kind, kind.detail or f"{kind.title}.", _TRACE).model_dump()
        }
        for kind in (*KINDS.values(), INVALID)
        if kind.status < 500 or kind.status in _ADMITTED
    }


def install(app: FastAPI) -> None:
    """Register the handlers."""
    app.add_exception_handler(RequestValidationError, _on_validation)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(Exception, _on_internal)
    app.add_exception_handler(ClientDisconnect, _on_disconnect)
    app.add_exception_handler(TaskError, _on_task)
    app.add_exception_handler(OSError, _on_system)
    for error in KINDS:
        app.add_exception_handler(error, _on_known)


def _answer(problem: Problem, headers: dict[str, str] | None = None) -> Response:
    return JSONResponse(
        problem.model_dump(), problem.status, media_type=MEDIA_TYPE, headers=headers
    )


async def _on_known(request: Request, error: Exception) -> Response:
    return answer_of(error, request)


def answer_of(error: Exception, request: Request) -> Response:
    """Make the answer to a request that fails with an error of KINDS; logs what is our fault."""
    metrics.count_fault(error)
    headers = {}
    if isinstance(error, UnauthorizedError):
        headers["WWW-Authenticate"] = "Bearer"
    if isinstance(error, QueueFullError | BusyError):
        headers["Retry-After"] = str(RETRY_SECONDS)
    if isinstance(error, QuotaError):
        headers["Retry-After"] = str(error.retry_seconds)
    if isinstance(error, SlowRequestError):
        headers["Connection"] = "close"
    if isinstance(error, RangeError):
        headers["Content-Range"] = f"bytes */{error.size}"
    if isinstance(error, StorageFullError):  # every request says so: no trace for each
        log.error("no room for a job: %s", error, extra={"trace_id": request.state.trace_id})
    elif isinstance(error, BusyError):
        log.warning("too many requests", extra={"trace_id": request.state.trace_id})
    elif isinstance(error, UnreadyError):  # balancers ask all the time, and a stop is no fault
        log.info("%s", error, extra={"trace_id": request.state.trace_id})
    elif kind_of(error).status >= 500:  # while store or database is away, so does every request
        said = f"{kind_of(error).name}: {cause_of(error)}"
        log.error("request failed, %s", said, extra={"trace_id": request.state.trace_id})
    return _answer(problem_of(error, request.state.trace_id), headers)


async def _on_disconnect(request: Request, _error: Exception) -> Response:
    # Nobody is there to read it; without it the log would call it a fault of ours.
    broken = MalformedRequestError("The connection broke before the whole request had come.")
    return _answer(problem_of(broken, request.state.trace_id))


async def _on_task(_request: Request, error: Exception) -> Response:
    assert isinstance(error, TaskError)
    return _answer(Problem(**error.problem))


async def _on_validation(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    detail = sentence_of_faults(error.errors())
    return _answer(make_problem(INVALID, detail, request.state.trace_id))


async def _on_http(request: Request, error: Exception) -> Response:
    # What the router itself refuses: unknown paths and methods.
    assert isinstance(error, HTTPException)
    kind = Kind(f"http-{error.status_code}", error.status_code, str(error.detail))
    headers = dict(error.headers or {})
    wrong, hint = f"{error.detail}.", "Check the address"
    if "Allow" in headers:  # with the methods of one route alone, and others may have the address
        headers["Allow"] = ", ".join(_methods(request))
        hint = f"This address takes {headers['Allow']}"
    detail = (
        f"{request.method} {request.url.path}: {wrong} {hint}; /docs lists what this service "
        "answers."
    )
    return _answer(make_problem(kind, detail, request.state.trace_id), headers)


def _methods(request: Request) -> list[str]:
    """What the address of a request may be asked with, by all routes that have it."""

    def is_taken(method: str) -> bool:
        asked = {**request.scope, "method": method}
        return any(route.matches(asked)[0] is Match.FULL for route in request.app.routes)

    return [method for method in (*METHODS, "OPTIONS") if is_taken(method)]


async def _on_system(request: Request, error: Exception) -> Response:
    assert isinstance(error, OSError)
    if error.errno in FULL:
        full = StorageFullError(
            "The disk that takes photographs in is full; send this one again later."
        )
        return answer_of(full, request)
    return await _on_internal(request, error)


async def _on_internal(request: Request, error: Exception) -> Response:
    trace_id = request.state.trace_id
    # An answer that has begun becomes no problem: its connection is closed, and it is not whole.
    known = error.__cause__ if isinstance(error, RuntimeError) else None
    if isinstance(known, Exception) and kind_of(known) is not INTERNAL:
        metrics.count_fault(known)
        log.warning("answer broken off: %s", kind_of(known).name, extra={"trace_id": trace_id})
    else:
        log.error("request failed", exc_info=error, extra={"trace_id": trace_id})
    # Sent by the outermost layer, where nothing else adds them.
    return _answer(problem_of(error, trace_id), {**DEFAULTS, "Trace-Id": trace_id})
