"""Whether the store is this database's: a random id lies in both.

What sweeps files that no row knows asks here, for the files of another database's jobs look just
like those that a killed request has left. See decision 36.
"""

from __future__ import annotations

import contextlib
import logging
from typing import Literal

import sqlalchemy as sa

from service.errors import StorageFullError
from service.object_keys import DATABASE_ID, JOBS, UPLOADS
from service.rows.tables import identity, jobs
from service.storage.base import Storage

_BATCH = 500  # ids in a statement

Standing = Literal["ours", "free", "foreign"]

log = logging.getLogger("service.belonging")


def id_of(engine: sa.Engine) -> str:
    """Give the database's id. Raises sqlalchemy.exc.DBAPIError."""
    with engine.connect() as connection:
        return str(connection.execute(sa.select(identity.c.id)).scalar_one())


def standing(engine: sa.Engine, storage: Storage) -> Standing:
    """Tell whose the store is; "free" is one that names nobody and may be taken.

    That is one without files, or with files of jobs that were in the database before it had an id.
    Raises sqlalchemy.exc.DBAPIError or obstore.exceptions.BaseError when one is away.
    """
    try:
        named = storage.get(DATABASE_ID)
    except FileNotFoundError:
        return "free" if _is_empty(storage) or _was_ours(engine, storage) else "foreign"
    return "ours" if named.strip() == id_of(engine).encode() else "foreign"


def claim(engine: sa.Engine, storage: Storage) -> bool:
    """Whether the store is this database's; a free one becomes so, and says it from now on.

    Safe to call at any time, from any process. Raises what standing raises.
    """
    found = standing(engine, storage)
    if found == "free":
        with contextlib.suppress(StorageFullError):  # the next one writes it
            storage.put(DATABASE_ID, id_of(engine).encode())
            storage.flush([DATABASE_ID])
    if found == "foreign":
        log.warning(
            "the store has files of another database, so those without a row stay; "
            "`lightlayers doctor` says what to do"
        )
    return found != "foreign"


def _is_empty(storage: Storage) -> bool:
    return not (storage.folders(JOBS) or storage.folders(UPLOADS))


def _was_ours(engine: sa.Engine, storage: Storage) -> bool:
    """Whether the store has files of a job that is older than the database's id."""
    older = jobs.c.created < sa.select(identity.c.created).scalar_subquery()
    stored = storage.folders(JOBS)
    for start in range(0, len(stored), _BATCH):
        one = jobs.c.id.in_(stored[start : start + _BATCH])
        with engine.connect() as connection:
            if connection.execute(sa.select(jobs.c.id).where(one, older).limit(1)).first():
                return True
    return False
