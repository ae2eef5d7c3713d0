"""Whether the service lives, and whether it can work."""

from __future__ import annotations

from collections.abc import Iterator

import sqlalchemy as sa
from fastapi import APIRouter
from obstore.exceptions import BaseError

from service import census, metrics
from service.api.context import Context, Parts
from service.api.models import Health
from service.api.problems import responses
from service.errors import UnreadyError

router = APIRouter(tags=["health"])


@router.get("/healthz", response_model=Health)
async def get_health() -> Health:
    """Tell that the process answers, whatever its threads wait for."""
    return Health()


@router.get("/readyz", response_model=Health, responses=responses(UnreadyError))
def get_readiness(context: Parts) -> Health:
    """Tell whether database and store answer and a worker lives; the problem names what lacks."""
    lacking = list(_lacking(context))
    if lacking:
        raise UnreadyError(f"The service is not ready: {'; '.join(lacking)}.")
    return Health()


def _lacking(context: Context) -> Iterator[str]:
    if context.draining.is_set():
        yield "it was told to stop"
    try:
        with context.engine.connect() as connection:
            workers = census.living_workers(connection, context.settings.silence_seconds)
        if not workers:
            yield "no worker lives, so start one with `lightlayers worker`"
    except sa.exc.SQLAlchemyError:
        yield "the database of jobs does not answer"
    try:
        context.storage.check()
    except (BaseError, OSError) as error:
        metrics.count_fault(error)
        yield "the store of photographs does not answer"
