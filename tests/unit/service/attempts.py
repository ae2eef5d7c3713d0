"""Attempts at jobs, as a worker that goes on would make them."""

from __future__ import annotations

from service.api.context import Context
from service.rows import jobs
from service.settings import Settings
from service.workers.attempt import Attempt


def attempt_at(
    held: jobs.Job | None, context: Context, settings: Settings | None = None
) -> Attempt:
    """An attempt at a job that was claimed. settings: in place of those of the context."""
    assert held is not None
    return Attempt(
        held,
        context.engine,
        context.storage,
        settings or context.settings,
        context.fork_server,
        lambda: False,
    )
