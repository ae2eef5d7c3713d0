"""Two databases and one bucket."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
import sqlalchemy as sa

from service import belonging, migrations, upload_pieces
from service.rows import database, tables, uploads
from service.storage.base import Storage
from service.storage.by_url import storage_at


@pytest.fixture
def storage(s3: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> Storage:
    for name, value in s3.items():
        monkeypatch.setenv(name, value)
    return storage_at("s3://photographs/of/two")


@pytest.fixture
def databases(make_database: Callable[[], str]) -> Iterator[list[sa.Engine]]:
    """Two on one server, both migrated."""
    engines = [database.connect(make_database()) for _ in range(2)]
    for engine in engines:
        migrations.upgrade(engine)
    yield engines
    for engine in engines:
        engine.dispose()


def test_the_second_database_leaves_the_bucket_of_the_first_alone(
    databases: list[sa.Engine], storage: Storage
) -> None:
    production, staging = databases
    assert belonging.claim(production, storage)
    with production.begin() as connection:
        uploads.add(connection, {"id": "a", "owner": "", "length": 9}, 60)
    storage.put("uploads/a/000-x", b"light")
    storage.put("uploads/nobodys/000-x", b"light")
    upload_pieces.remove_expired(staging, storage, strays=belonging.claim(staging, storage))
    assert storage.folders("uploads/") == ["a", "nobodys"]
    upload_pieces.remove_expired(production, storage, strays=belonging.claim(production, storage))
    assert storage.folders("uploads/") == ["a"]


def test_a_bucket_from_before_names_goes_to_the_database_that_has_its_jobs(
    databases: list[sa.Engine], storage: Storage
) -> None:
    production, staging = databases
    storage.delete("database-id")
    storage.put("jobs/a/inputs/flash", b"light")
    row = {"id": "a", "state": "queued", "options": {}, "trace_id": "1", "request_hash": ""}
    with production.begin() as connection:
        connection.execute(sa.insert(tables.jobs).values(created=1000.0, **row))
    assert belonging.standing(staging, storage) == "foreign"
    assert belonging.standing(production, storage) == "free"
    assert belonging.claim(production, storage)
    assert belonging.standing(production, storage) == "ours"
    assert belonging.standing(staging, storage) == "foreign"
