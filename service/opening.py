"""Opens the database and the store of the settings, or says what is wrong with them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from urllib.parse import urlsplit

import sqlalchemy as sa
from obstore.exceptions import BaseError

from service import migrations
from service.dbos_queue import queue
from service.errors import StartError
from service.problems import cause_of
from service.rows import database
from service.settings import Settings
from service.storage.base import Storage
from service.storage.by_url import storage_at

WRONG_ADDRESS = (
    "The address in LIGHTLAYERS_DATABASE_URL cannot be used: write one like sqlite:///file or "
    "postgresql://user:password@host/name, with @ : / of the password as %40 %3A %2F."
)

NO_ROOM = "The disk of the database of jobs is full: make room on it."

_NO_CREDENTIALS = ("169.254.169.254", "Missing AccessKeyId", "Missing SecretAccessKey")
"""What the store's client says without them; the address is that of Amazon's own machines."""

_NO_TLS = "builder error"
"""What it says of a request by plain HTTP that it was not allowed to make."""

_ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT")


def open_database(settings: Settings) -> sa.Engine:
    """Connect to a database whose tables are those of this program. Raises StartError.

    A database in a file, which is this machine's alone, is migrated on the way. One that hosts
    share is migrated by a command, at a moment that its operator chooses.
    """
    with _start_errors():
        connected = database.connect(settings.database_url)
        try:
            if connected.dialect.name == "sqlite":
                _migrate(connected)
            else:
                migrations.check(connected)
        except Exception:
            connected.dispose()
            raise
    return connected


def migrate_database(settings: Settings) -> tuple[str | None, str]:
    """Bring the tables of jobs and queue up to date; versions before and after.

    Raises StartError.
    """
    with _start_errors():
        connected = database.connect(settings.database_url)
        try:
            return _migrate(connected)
        finally:
            connected.dispose()


def _migrate(connected: sa.Engine) -> tuple[str | None, str]:
    queue.migrate(connected)
    return migrations.upgrade(connected)


@contextlib.contextmanager
def _start_errors() -> Iterator[None]:
    """Raise StartError, and say what to do, where the database cannot be opened or migrated."""
    try:
        yield
    except (sa.exc.ArgumentError, ValueError):  # whose text may have a part of the password
        raise StartError(WRONG_ADDRESS) from None
    except migrations.SchemaError as error:
        raise StartError(str(error)) from error
    except (sa.exc.SQLAlchemyError, OSError, ImportError) as error:
        if database.is_full(error):
            raise StartError(NO_ROOM) from error
        raise StartError(
            "The database of jobs cannot be opened: check LIGHTLAYERS_DATABASE_URL and "
            f"LIGHTLAYERS_DATA_DIR ({cause_of(error)})."
        ) from error


def open_storage(settings: Settings) -> Storage:
    """Open the store of photographs and results, which must answer. Raises StartError."""
    if settings.store_url.startswith("s3:"):
        _check_endpoint()
    try:
        storage = storage_at(settings.store_url)
        storage.check()
        if settings.store_presign:
            _check_signing(storage)
    except (BaseError, OSError, ValueError) as error:
        if any(sign in cause_of(error) for sign in _NO_CREDENTIALS):
            raise StartError(
                "The store of photographs that LIGHTLAYERS_STORE_URL names is given no "
                "credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY."
            ) from error
        if _NO_TLS in cause_of(error):
            raise StartError(
                "The store of photographs is reached by plain HTTP, which has to be allowed: set "
                "AWS_ALLOW_HTTP=true."
            ) from error
        raise StartError(
            "The store of photographs cannot be opened: check LIGHTLAYERS_STORE_URL and the "
            f"AWS_ variables ({cause_of(error)})."
        ) from error
    return storage


def _check_endpoint() -> None:
    """Refuse an address that is none: the store's client would not refuse it, but crash."""
    for name in _ENDPOINTS:
        if name in os.environ and not _is_address(os.environ[name]):
            raise StartError(
                f"{name} is no address of a store: write one like https://host:port, or leave it "
                "out."
            )


def _is_address(text: str) -> bool:
    try:
        parts = urlsplit(text)
        named = parts.port != 0 and bool(parts.hostname)
    except ValueError:
        return False
    return named and parts.scheme in ("https", "http") and not any(map(str.isspace, text))


def _check_signing(storage: Storage) -> None:
    try:
        storage.link("health", 1)
    except BaseError as error:
        raise StartError(
            "URLs of the store cannot be signed: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, "
            "or leave LIGHTLAYERS_STORE_PRESIGN out."
        ) from error
