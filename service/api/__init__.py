"""The HTTP API."""

from __future__ import annotations

import importlib.metadata
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from fastapi import Depends, FastAPI
from fastapi.concurrency import run_in_threadpool

from service import database, engine
from service.api import cameras, health, jobs, problems, results
from service.api.context import Context
from service.api.hosts import check_host
from service.errors import ForeignHostError, Problem
from service.settings import Settings
from service.storage import Storage


def create_app(settings: Settings) -> FastAPI:
    """Make the app; it opens database, queue and store when it starts."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        context = await run_in_threadpool(_open, settings)
        app.state.context = context
        yield
        await run_in_threadpool(context.queue.close)
        await run_in_threadpool(context.engine.dispose)

    app = FastAPI(
        title="lightlayers",
        summary="The light of every lamp in a room as a layer of its own.",
        version=importlib.metadata.version("lightlayers"),
        lifespan=lifespan,
        dependencies=[Depends(check_host)],
        redirect_slashes=False,
        generate_unique_id_function=lambda route: route.name,
    )
    problems.install(app)
    for module in (jobs, results, cameras, health):
        app.include_router(
            module.router, responses=problems.responses(ForeignHostError, status=(422,))
        )
    make_document = app.openapi

    def openapi() -> dict[str, Any]:
        document = make_document()
        schemas = document["components"]["schemas"]
        for model in (*jobs.SCHEMAS, Problem):
            schema = model.model_json_schema(ref_template="#/components/schemas/{model}")
            schemas |= schema.pop("$defs", {})
            schemas[model.__name__] = schema
        # Never sent: a validation fault is a Problem like any other.
        schemas.pop("HTTPValidationError", None)
        schemas.pop("ValidationError", None)
        return document

    app.openapi = openapi  # type: ignore[method-assign]  # FastAPI's documented way
    return app


def _open(settings: Settings) -> Context:
    connected = database.connect(settings.database_url)
    engine.migrate(connected)
    database.create_tables(connected)
    return Context(settings, connected, engine.Queue(connected), Storage(settings.store_url))
