"""Whether the service lives, and whether it can work."""

from __future__ import annotations

import asyncio
from functools import partial

import sqlalchemy as sa
from anyio import to_thread
from fastapi import APIRouter
from obstore.exceptions import BaseError

from service import metrics
from service.answers import Health
from service.api.context import Context, Parts
from service.api.problems import responses
from service.errors import UnreadyError
from service.rows import census

_ANSWER_SECONDS = 3.0  # for database and store, both at once: who asks waits seldom longer

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
    lacking = ["it was told to stop"] if context.draining.is_set() else []
    for found in await asyncio.gather(_lacking_database(context), _lacking_store(context)):
        lacking += found
    if lacking:
        raise UnreadyError(f"The service is not ready: {'; '.join(lacking)}.")
    return Health()


async def _lacking_database(context: Context) -> list[str]:
    count = partial(_living_workers, context)
    try:
        async with asyncio.timeout(_ANSWER_SECONDS):
            # What hangs is left to its thread, of which there are few: those of routes stay free.
            workers = await to_thread.run_sync(
                count, abandon_on_cancel=True, limiter=context.probing
            )
    except (sa.exc.SQLAlchemyError, TimeoutError):
        return ["the database of jobs does not answer"]
    return [] if workers else ["no worker lives, so start one with `lightlayers worker`"]


def _living_workers(context: Context) -> int:
    with context.engine.connect() as connection:
        return census.living_workers(connection, context.settings.silence_seconds)


async def _lacking_store(context: Context) -> list[str]:
    # In no thread: while a store hangs, balancers that ask again and again would take all of them.
    try:
        await context.storage.check_within(_ANSWER_SECONDS)
    except (BaseError, OSError) as error:
        metrics.count_fault(error)
        return ["the store of photographs does not answer"]
    return []
