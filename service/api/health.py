"""Whether the service lives, and whether it can work."""

from __future__ import annotations

import sqlalchemy as sa
from fastapi import APIRouter
from fastapi.concurrency import run_in_threadpool
from obstore.exceptions import BaseError

from service import metrics
from service.answers import Health
from service.api.context import Context, Parts
from service.api.problems import responses
from service.errors import UnreadyError
from service.rows import census

_STORE_SECONDS = 5.0  # for the store to answer: who asks for readiness waits seldom longer

router = APIRouter(tags=["health"])


@router.head("/healthz", include_in_schema=False)
@router.get("/healthz", response_model=Health)
async def get_health() -> Health:
    """Tell that the process answers, whatever its threads wait for."""
    return Health()


@router.head("/readyz", include_in_schema=False)
@router.get("/readyz", response_model=Health, responses=responses(UnreadyError))
async def get_readiness(context: Parts) -> Health:
    """Tell whether database and store answer and a worker lives; the problem names what lacks."""
    lacking = [*await run_in_threadpool(_lacking, context), *await _lacking_store(context)]
    if lacking:
        raise UnreadyError(f"The service is not ready: {'; '.join(lacking)}.")
    return Health()


def _lacking(context: Context) -> list[str]:
    lacking = ["it was told to stop"] if context.draining.is_set() else []
    try:
        with context.engine.connect() as connection:
            workers = census.living_workers(connection, context.settings.silence_seconds)
        if not workers:
            lacking.append("no worker lives, so start one with `lightlayers worker`")
    except sa.exc.SQLAlchemyError:
        lacking.append("the database of jobs does not answer")
    return lacking


async def _lacking_store(context: Context) -> list[str]:
    # In no thread: while a store hangs, balancers that ask again and again would take all of them.
    try:
        await context.storage.check_within(_STORE_SECONDS)
    except (BaseError, OSError) as error:
        metrics.count_fault(error)
        return ["the store of photographs does not answer"]
    return []
