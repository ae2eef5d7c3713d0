"""Whether there is room for another job."""

from __future__ import annotations

import sqlalchemy as sa

from pipeline.errors import counted
from service.errors import QueueFullError, StartError, StorageFullError
from service.rows import quotas, waiting
from service.settings import Settings
from service.storage.base import Storage


def check_room(
    engine: sa.Engine, settings: Settings, storage: Storage, owner: str, coming: int = 1
) -> None:
    """Refuse new jobs of an owner where there is no room for them. coming: how many.

    Raises QueueFullError when as many jobs wait as may, of this owner or in all, and what
    quotas.check and check_disk raise.
    """
    with engine.connect() as connection:
        quotas.check(connection, owner, coming)
        own = waiting.count_queued(connection, owner)
        total = waiting.count_queued(connection)
    of_key, in_all = settings.queued_jobs_per_key, settings.queued_jobs
    if own + coming > of_key:
        wait = counted(own, "job of yours waits", "jobs of yours wait")
        raise QueueFullError(_full(wait, own, coming, of_key))
    if total + coming > in_all:
        wait = counted(total, "job waits", "jobs wait")
        raise QueueFullError(_full(wait, total, coming, in_all))
    check_disk(settings, storage)


def check_disk(settings: Settings, storage: Storage) -> None:
    """Raise StorageFullError when the store's disk is nearly full."""
    free = storage.free_bytes()
    if free is not None and free < settings.free_bytes:
        raise StorageFullError(
            "The store of photographs is nearly full; delete jobs, or send this one again later."
        )


def check_setting(settings: Settings, storage: Storage) -> None:
    """Raise StartError when no job could ever be taken, be the store's disk as empty as it may."""
    size = storage.disk_bytes()
    if size is not None and size < settings.free_bytes:
        raise StartError(larger_than_disk(settings, size))


def larger_than_disk(settings: Settings, size: int) -> str:
    """Say that a disk of so many bytes never has as much free as is to be left free."""
    return (
        f"LIGHTLAYERS_FREE_BYTES is {settings.free_bytes}, and the store's disk has {size} in all, "
        "so that every job would be refused: set less, or put the store on a larger disk."
    )


def _full(wait: str, queued: int, coming: int, limit: int) -> str:
    if coming == 1:
        return f"{wait} already; send this one again later."
    if queued >= limit:  # not even one of them has room
        return f"{wait} already; ask for these {coming} again later."
    return f"{wait} already, and {limit} may; ask for fewer than these {coming}, or later."
