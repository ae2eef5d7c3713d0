"""Whether the service lives, and whether it can work."""

from __future__ import annotations

import sqlalchemy as sa
from fastapi import APIRouter

from service.api.context import Parts
from service.api.models import Health
from service.api.problems import responses

router = APIRouter(tags=["health"])


@router.get("/healthz", response_model=Health)
def get_health() -> Health:
    """Tell that the process answers."""
    return Health()


@router.get("/readyz", response_model=Health, responses=responses(status=(503,)))
def get_readiness(context: Parts) -> Health:
    """Tell whether database and store answer."""
    with context.engine.connect() as connection:
        connection.execute(sa.select(1))
    context.storage.check()
    return Health()
