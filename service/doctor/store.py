"""Whether the store of photographs can be used, and is this database's."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from typing import Literal

import sqlalchemy as sa
from obstore.exceptions import BaseError

from service import belonging, migrations
from service.doctor.database import is_missing_file
from service.doctor.finding import Finding
from service.errors import StartError, StorageFullError
from service.object_keys import DATABASE_ID
from service.opening import open_storage
from service.problems import cause_of
from service.room import larger_than_disk
from service.rows import database
from service.settings import Settings
from service.storage.base import Storage


def look(settings: Settings) -> Iterator[Finding]:
    """Look at the store: write into it, read and delete that, and see its room and its owner."""
    key = f"health/{uuid.uuid4().hex}"
    try:
        storage = open_storage(settings)
        storage.put(key, b"light")
        read = storage.get(key)
        storage.delete_below("health/")
    except StartError as error:
        yield Finding("wrong", "store", str(error))
        return
    except StorageFullError as error:
        yield Finding("wrong", "store", str(error))
        yield from _answering(storage, settings)
        return
    except (BaseError, OSError) as error:
        yield Finding(
            "wrong",
            "store",
            f"it answers and cannot be written ({cause_of(error)}): allow reading, writing, "
            "listing and deleting, or see what its own log says.",
        )
        return
    grade: Literal["ok", "wrong"] = "ok" if read == b"light" else "wrong"
    yield Finding(grade, "store", "what is written can be read, listed and deleted.")
    yield from _answering(storage, settings)


def _answering(storage: Storage, settings: Settings) -> Iterator[Finding]:
    """What a store tells that answers; one that hangs would keep waiting whoever asks again."""
    yield from _room(storage, settings)
    yield from _belonging(storage, settings)


def _belonging(storage: Storage, settings: Settings) -> Iterator[Finding]:
    """Whose the store is; nothing where the database does not answer, which is told already."""
    if is_missing_file(settings.database_url):
        return
    try:
        engine = database.connect(settings.database_url)
    except (sa.exc.SQLAlchemyError, ValueError, OSError, ImportError):
        return
    try:
        migrations.check(engine)
        if belonging.standing(engine, storage) == "foreign":
            yield Finding(
                "wrong",
                "store's database",
                "the store has files of another database, or of one that is lost, so no file "
                "without a job is removed: correct LIGHTLAYERS_STORE_URL, or, where no other "
                f"service uses the store, write {belonging.id_of(engine)} into its object "
                f"`{DATABASE_ID}`, and files of jobs that are not in this database are removed.",
            )
        else:
            yield Finding("ok", "store's database", "it is this one.")
    except (migrations.SchemaError, sa.exc.SQLAlchemyError, BaseError, OSError):
        return
    finally:
        engine.dispose()


def _room(storage: Storage, settings: Settings) -> Iterator[Finding]:
    try:
        free, size = storage.free_bytes(), storage.disk_bytes()
    except BaseError as error:
        yield Finding("wrong", "store's disk", f"{cause_of(error)}: see what lies at its place.")
        return
    if free is None or size is None:  # on no disk of ours
        return
    if size < settings.free_bytes:
        yield Finding("wrong", "store's disk", larger_than_disk(settings, size))
        return
    said = f"{free / 2**30:.1f} GiB are free for photographs and results"
    if free < settings.free_bytes:
        less = "less than LIGHTLAYERS_FREE_BYTES: new jobs are refused; make room."
        yield Finding("wrong", "store's disk", f"{said}, {less}")
    else:
        yield Finding("ok", "store's disk", f"{said}.")
