"""Opens the database and the store of the settings, or says what is wrong with them."""

from __future__ import annotations

import sqlalchemy as sa
from obstore.exceptions import BaseError

from service import database, engine
from service.errors import StartError
from service.settings import Settings
from service.storage import Storage


def open_database(settings: Settings) -> sa.Engine:
    """Connect, and create the tables of jobs and queue that are missing. Raises StartError."""
    try:
        sa.make_url(settings.database_url)
    except (sa.exc.ArgumentError, ValueError):  # whose text may have a part of the password
        raise StartError(
            "The address in LIGHTLAYERS_DATABASE_URL cannot be read: write one like sqlite:///file "
            "or postgresql://user:password@host/name, with @ : / of the password as %40 %3A %2F."
        ) from None
    try:
        connected = database.connect(settings.database_url)
        engine.migrate(connected)
        database.create_tables(connected)
    except (sa.exc.SQLAlchemyError, OSError, ImportError) as error:
        raise StartError(
            "The database of jobs cannot be opened: check LIGHTLAYERS_DATABASE_URL and "
            f"LIGHTLAYERS_DATA_DIR ({_cause(error)})."
        ) from error
    return connected


def open_storage(settings: Settings) -> Storage:
    """Open the store of photographs and results, which must answer. Raises StartError."""
    try:
        storage = Storage(settings.store_url)
        storage.check()
    except (BaseError, OSError, ValueError) as error:
        raise StartError(
            "The store of photographs cannot be opened: check LIGHTLAYERS_STORE_URL and the "
            f"AWS_ variables ({_cause(error)})."
        ) from error
    return storage


def _cause(error: Exception) -> str:
    """Give the first line of what went wrong; no library puts a password there."""
    original = getattr(error, "orig", None) or error
    return str(original).strip().partition("\n")[0].rstrip(".")
