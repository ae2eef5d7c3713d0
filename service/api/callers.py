"""Who sends a request, and what they may do."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass
from typing import Annotated, Any

import sqlalchemy as sa
from fastapi import Depends, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.security import HTTPBearer

from service.api.context import Context, Parts
from service.api.hosts import came_through_proxy, check_origin
from service.errors import ForbiddenError, UnauthorizedError, UnknownJobError
from service.rows import jobs, keys
from service.rows.database import AWAY
from service.rows.keys import Scope
from service.settings import Settings

OPEN = ("/healthz", "/readyz", "/", "/page/{name}")
"""Routes that ask for no key: they tell only that the service lives, and what its page is."""

STANDING_SECONDS = 15.0
"""How often it is asked whether the key of a stream is still good."""

SCHEME = HTTPBearer(
    scheme_name="key",
    bearerFormat="ll_<id>_<secret>",
    description="A key that `lightlayers keys create` made. Its scopes say what it is good for: "
    "`read` looks at jobs and fetches results; `submit` sends photographs, makes, cancels and "
    "deletes jobs; `capture` uses cameras, also to make jobs, and confirms what jobs ask for; "
    "`admin` does all of it, with the jobs of every key. A service on loopback wants none until "
    "the first was made.",
    auto_error=False,
)


@dataclass(frozen=True)
class Caller:
    """Who sends a request; owner: id of the key, "" where the service asks for none."""

    owner: str
    scopes: frozenset[Scope] = frozenset(set(Scope) - {Scope.ADMIN})

    @property
    def lists(self) -> str | None:
        """Whose jobs a list shows: the owner's own, or, for None, those of all."""
        return None if Scope.ADMIN in self.scopes else self.owner

    def may_see(self, job: jobs.Job) -> bool:
        """Whether a job is the caller's, or the caller an administrator."""
        return self.lists in (None, job.owner)

    def need(self, *scopes: Scope) -> None:
        """Go on if the caller has one of these scopes. Raises ForbiddenError."""
        if self.scopes.isdisjoint({Scope.ADMIN, *scopes}):
            wanted = " or ".join(scopes)
            raise ForbiddenError(f"This key lacks the scope {wanted}; use one that has it.")


def scopes_for(method: str, path: str) -> tuple[Scope, ...]:
    """Scopes of which a caller needs one for a route; path: as the route was declared."""
    if path.startswith("/cameras") or path.endswith("/confirm"):
        return (Scope.CAPTURE,)
    if path.startswith("/uploads"):  # who sends one asks how far it came
        return (Scope.SUBMIT,)
    if method == "POST" and path in ("/jobs", "/calibrations"):  # which of them, the body says
        return (Scope.SUBMIT, Scope.CAPTURE)
    return (Scope.READ,) if method in ("GET", "HEAD") else (Scope.SUBMIT,)


async def identify(
    request: Request,
    context: Parts,
    _described: Annotated[Any, Depends(SCHEME)],
) -> Caller | None:
    """Find out who sends a request; None on OPEN routes, which wait for no thread here.

    Asked of the database each time, so that a revoked key ends with the next request on every
    host; streams ask again as they go on, see Standing. Raises UnauthorizedError, ForbiddenError,
    ForeignOriginError.
    """
    path = request.scope["route"].path
    if path in OPEN:
        return None
    caller = await run_in_threadpool(_caller_of, request, context)
    caller.need(*scopes_for(request.method, path))
    return caller


def _caller_of(request: Request, context: Context) -> Caller:
    scheme, _, text = request.headers.get("authorization", "").partition(" ")
    with context.engine.connect() as connection:
        if not scheme:
            _check_keyless(connection, request, context.settings)
            return Caller("")
        key = keys.find(connection, text.strip()) if scheme.lower() == "bearer" else None
    if key is None:
        raise UnauthorizedError("This key is not good here: it is mistyped, revoked or expired.")
    if key.used is None or key.used < time.time() - keys.USED_SECONDS:
        # A key is good on a full disk, too, where nothing can be noted.
        with contextlib.suppress(*AWAY), context.engine.begin() as connection:
            keys.note_use(connection, key)
    return Caller(key.id, key.scopes)


class Standing:
    """Whether the caller of a stream may still read it: a key may be revoked while it goes on."""

    def __init__(self, engine: sa.Engine, caller: Caller) -> None:
        self._engine, self._caller = engine, caller
        self._asked = time.monotonic()

    async def holds(self) -> bool:
        """Ask the database, unless that was done just now; while it is away, the caller may."""
        if time.monotonic() - self._asked < STANDING_SECONDS:
            return True
        self._asked = time.monotonic()
        with contextlib.suppress(*AWAY):
            return await run_in_threadpool(self._look)
        return True

    def _look(self) -> bool:
        with self._engine.connect() as connection:
            if self._caller.owner:
                return keys.is_usable(connection, self._caller.owner)
            return not keys.any_made(connection)


def _check_keyless(connection: sa.Connection, request: Request, settings: Settings) -> None:
    if keys.required(settings) or came_through_proxy(request) or keys.any_made(connection):
        raise UnauthorizedError(
            "This service needs a key: send `Authorization: Bearer ll_…`, and let commands have it "
            "in LIGHTLAYERS_KEY; who runs the service makes one with `lightlayers keys create`."
        )
    check_origin(request, settings)


def _known(caller: Annotated[Caller | None, Depends(identify)]) -> Caller:
    assert caller is not None  # no OPEN route asks who calls
    return caller


Calling = Annotated[Caller, Depends(_known)]


def find(connection: sa.Connection, caller: Caller, job_id: str) -> jobs.Job:
    """Find a job of the caller's. Raises UnknownJobError, also for those of others."""
    job = jobs.find(connection, job_id)
    if job is None or not caller.may_see(job):
        raise UnknownJobError(job_id)
    return job


def describe(paths: dict[str, Any]) -> None:
    """Say in the paths of the OpenAPI document which scopes each operation takes one of."""
    for path, operations in paths.items():
        for method, operation in operations.items():
            scopes = () if path in OPEN else scopes_for(method.upper(), path)
            operation["security"] = [{SCHEME.scheme_name: [scope]} for scope in scopes]
