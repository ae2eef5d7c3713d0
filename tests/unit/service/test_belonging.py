from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import sqlalchemy as sa

from service import belonging, migrations
from service.errors import StorageFullError
from service.rows import database, jobs, tables
from service.storage.base import Storage
from service.storage.folder import FolderStorage
from tests.unit.service.at_first import raising

Open = Callable[[str], sa.Engine]


@pytest.fixture
def open_one(tmp_path: Path) -> Iterator[Open]:
    """Open a migrated database of this name."""
    opened = []

    def connect(name: str) -> sa.Engine:
        engine = database.connect(f"sqlite:///{tmp_path / name}")
        opened.append(engine)
        migrations.upgrade(engine)
        return engine

    yield connect
    for engine in opened:
        engine.dispose()


@pytest.fixture
def migrated(open_one: Open) -> sa.Engine:
    return open_one("jobs.sqlite")


def _add(engine: sa.Engine, storage: Storage, job_id: str, created: float | None = None) -> None:
    """Add a job with its files; created: in place of now."""
    row = {"id": job_id, "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    storage.put(f"jobs/{job_id}/inputs/flash", b"light")
    with engine.begin() as connection:
        jobs.add(connection, row)
        if created is not None:
            connection.execute(sa.update(tables.jobs).values(created=created))


def _named(storage: Storage) -> str | None:
    try:
        return storage.get("database-id").decode()
    except FileNotFoundError:
        return None


def test_an_empty_store_is_taken_once_and_for_good(migrated: sa.Engine, storage: Storage) -> None:
    assert belonging.standing(migrated, storage) == "free"
    assert _named(storage) is None  # nothing is written by a look
    assert belonging.claim(migrated, storage)
    assert _named(storage) == belonging.id_of(migrated)
    _add(migrated, storage, "a")
    assert belonging.standing(migrated, storage) == "ours"
    assert belonging.claim(migrated, storage)


def test_databases_have_names_of_their_own_that_stay(open_one: Open) -> None:
    first, second = open_one("first"), open_one("second")
    name = belonging.id_of(first)
    assert len(name) == 32 and name != belonging.id_of(second)
    assert belonging.id_of(open_one("first")) == name


@pytest.mark.parametrize("key", ["jobs/a/inputs/flash", "uploads/a/000-x"])
def test_a_new_database_takes_no_store_with_files(
    key: str, migrated: sa.Engine, storage: Storage, caplog: pytest.LogCaptureFixture
) -> None:
    storage.put(key, b"light")
    assert not belonging.claim(migrated, storage)
    assert _named(storage) is None
    assert [record.levelname for record in caplog.records] == ["WARNING"]


def test_nor_does_it_once_it_has_jobs_there(migrated: sa.Engine, storage: Storage) -> None:
    storage.put("jobs/anothers/inputs/flash", b"light")
    _add(migrated, storage, "a")
    assert not belonging.claim(migrated, storage)


@pytest.mark.parametrize("batch", [1, 500])
def test_a_database_from_before_names_takes_the_store_with_its_jobs(
    batch: int, migrated: sa.Engine, storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(belonging, "_BATCH", batch)
    _add(migrated, storage, "b", created=1000.0)
    for name in ("a", "c"):
        storage.put(f"jobs/{name}/inputs/flash", b"light")
    assert belonging.claim(migrated, storage)
    assert _named(storage) == belonging.id_of(migrated)


def test_a_database_from_before_names_takes_no_store_without_its_jobs(
    migrated: sa.Engine, storage: Storage
) -> None:
    _add(migrated, storage, "a", created=1000.0)
    storage.delete_below("jobs/a/")
    storage.put("jobs/anothers/inputs/flash", b"light")
    assert not belonging.claim(migrated, storage)


def test_a_store_that_names_another_database_is_its_own_though_it_is_empty(
    open_one: Open, storage: Storage
) -> None:
    first, second = open_one("first"), open_one("second")
    assert belonging.claim(first, storage)
    assert not belonging.claim(second, storage)
    assert _named(storage) == belonging.id_of(first)


@pytest.mark.parametrize("text", [b"", b"\xff\x00", b"0" * 32])
def test_what_names_nobody_is_not_overwritten(
    text: bytes, migrated: sa.Engine, storage: Storage
) -> None:
    storage.put("database-id", text)
    assert not belonging.claim(migrated, storage)
    assert storage.get("database-id") == text


def test_a_name_that_an_operator_has_written_counts(migrated: sa.Engine, storage: Storage) -> None:
    storage.put("jobs/a/inputs/flash", b"light")
    storage.put("database-id", f"{belonging.id_of(migrated)}\n".encode())
    assert belonging.claim(migrated, storage)


def test_a_full_disk_keeps_no_sweep_from_its_work(
    migrated: sa.Engine, storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as filled:
        filled.setattr(FolderStorage, "put", raising(StorageFullError("full")))
        assert belonging.claim(migrated, storage)
    assert _named(storage) is None
    assert belonging.claim(migrated, storage)
    assert _named(storage) == belonging.id_of(migrated)
