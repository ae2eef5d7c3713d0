"""Whether there is room for another job."""

from __future__ import annotations

from service import quotas, waiting
from service.api.context import Context
from service.api.idempotency import find_earlier
from service.api.submission import Submission
from service.errors import QueueFullError, StorageFullError


def refuse_when_full(submission: Submission, coming: int = 1) -> None:
    """Refuse new jobs where there is no room for them: before their body is read, and once it is.

    One whose idempotency key made a job already passes. coming: how many jobs. Raises
    QueueFullError when as many jobs wait as may, of this caller or in all, StorageFullError when
    the store's disk is nearly full, and what quotas.check raises.
    """
    if find_earlier(submission):
        return
    context, owner = submission.context, submission.caller.owner
    with context.engine.connect() as connection:
        quotas.check(connection, owner, coming)
        own = waiting.count_queued(connection, owner)
        total = waiting.count_queued(connection)
    of_key, in_all = context.settings.queued_jobs_per_key, context.settings.queued_jobs
    if own + coming > of_key:
        raise QueueFullError(_full(f"{own} jobs of yours wait already", coming, of_key))
    if total + coming > in_all:
        raise QueueFullError(_full(f"{total} jobs wait already", coming, in_all))
    refuse_when_disk_full(context)


def _full(said: str, coming: int, limit: int) -> str:
    if coming == 1:
        return f"{said}; send this one again later."
    return f"{said}, and {limit} may; ask for fewer than these {coming}, or later."


def refuse_when_disk_full(context: Context) -> None:
    """Raise StorageFullError when the store's disk is nearly full."""
    free = context.storage.free_bytes()
    if free is not None and free < context.settings.free_bytes:
        raise StorageFullError(
            "The store of photographs is nearly full; delete jobs, or send this one again later."
        )
