"""The HTTP API."""

from __future__ import annotations

import importlib.metadata
from typing import Any

from fastapi import Depends, FastAPI

from service.api import calibrations, cameras, health, jobs, mixes, page, problems, results
from service.api.calibrated import allow_calibrations
from service.api.hosts import check_host
from service.errors import ForeignHostError, Problem


def create_app() -> FastAPI:
    """Make the app; whoever serves it puts a Context into app.state.context first."""
    app = FastAPI(
        title="lightlayers",
        summary="The light of every lamp in a room as a layer of its own.",
        version=importlib.metadata.version("lightlayers"),
        dependencies=[Depends(check_host)],
        redirect_slashes=False,
        generate_unique_id_function=lambda route: route.name,
    )
    problems.install(app)
    for module in (jobs, calibrations, mixes, results, cameras, health, page):
        app.include_router(
            module.router, responses=problems.responses(ForeignHostError, status=(422,))
        )
    make_document = app.openapi

    def openapi() -> dict[str, Any]:
        document = make_document()
        schemas = document["components"]["schemas"]
        for model in (*jobs.SCHEMAS, *calibrations.SCHEMAS, *mixes.SCHEMAS, Problem):
            schema = model.model_json_schema(ref_template="#/components/schemas/{model}")
            schemas |= schema.pop("$defs", {})
            schemas[model.__name__] = schema
        allow_calibrations(schemas)
        # Never sent: a validation fault is a Problem like any other.
        schemas.pop("HTTPValidationError", None)
        schemas.pop("ValidationError", None)
        return document

    app.openapi = openapi  # type: ignore[method-assign]  # FastAPI's documented way
    return app
