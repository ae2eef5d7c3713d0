"""The HTTP API."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Sequence
from typing import Any

from fastapi import Depends, FastAPI
from fastapi.middleware.cors import CORSMiddleware

from service.api import (
    areas,
    calibrations,
    callers,
    cameras,
    documents,
    events,
    examples,
    headers,
    health,
    jobs,
    manifest_schema,
    mixes,
    page,
    problems,
    reruns,
    results,
    tus,
    uploads,
)
from service.api.hosts import check_host
from service.api.limits import Limits
from service.api.named_calibrations import allow_calibrations
from service.api.queries import check_query
from service.api.trace_ids import TraceIds
from service.errors import ForbiddenError, ForeignHostError, ForeignOriginError, UnauthorizedError
from service.problems import Problem


def create_app(origins: Sequence[str] = ()) -> FastAPI:
    """Make the app; whoever serves it puts a Context into app.state.context first.

    origins: of web pages elsewhere that may ask.
    """
    app = FastAPI(
        title="lightlayers",
        summary="The light of every lamp in a room as a layer of its own.",
        version=importlib.metadata.version("lightlayers"),
        dependencies=[Depends(check_host), Depends(callers.identify)],
        docs_url=None,
        redoc_url=None,
        openapi_url=None,
        redirect_slashes=False,
        generate_unique_id_function=lambda route: route.name,
        # Spans of requests, where service.tracing sends them; the rest is in service.metrics.
        telemetry={
            "auto_configure": False,
            "operation_spans": False,
            "metrics": False,
            "logs": False,
        },
    )
    app.add_middleware(Limits)
    if origins:
        app.add_middleware(
            CORSMiddleware,
            allow_origins=origins,
            allow_methods=headers.METHODS,
            allow_headers=headers.SENT,
            expose_headers=headers.SHOWN,
        )
    app.add_middleware(TraceIds)
    problems.install(app)
    app.add_middleware(tus.Tus)
    app.add_middleware(headers.SafeHeaders)
    app.include_router(health.router, responses=problems.responses(ForeignHostError, status=(422,)))
    app.include_router(documents.router)
    app.include_router(page.router)
    refusals = (UnauthorizedError, ForbiddenError, ForeignHostError, ForeignOriginError)
    for module in (jobs, reruns, events, calibrations, mixes, uploads, results, areas, cameras):
        app.include_router(
            module.router,
            dependencies=[Depends(check_query)],
            responses=problems.responses(*refusals, status=(422,)),
        )
    make_document = app.openapi
    app.openapi = lambda: _completed(make_document())  # type: ignore[method-assign]  # documented
    return app


def _completed(document: dict[str, Any]) -> dict[str, Any]:
    """Add to FastAPI's OpenAPI document what it cannot know; the document."""
    schemas = document["components"]["schemas"]
    named = [
        model for part in (jobs, reruns, calibrations, mixes, cameras) for model in part.SCHEMAS
    ]
    for model in (*named, Problem):
        schema = model.model_json_schema(ref_template="#/components/schemas/{model}")
        schemas |= schema.pop("$defs", {})
        schemas[model.__name__] = schema
    schemas |= manifest_schema.SCHEMAS
    allow_calibrations(schemas)
    callers.describe(document["paths"])
    tus.describe(document["paths"])
    # Never sent: a validation fault is a Problem like any other.
    schemas.pop("HTTPValidationError", None)
    schemas.pop("ValidationError", None)
    document["components"]["examples"] = problems.examples()
    examples.add(document)
    return document
