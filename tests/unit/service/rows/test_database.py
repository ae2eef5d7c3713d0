from __future__ import annotations

import sqlite3
from pathlib import Path

import psycopg.errors
import pytest
import sqlalchemy as sa

from service.rows import cameras, database, jobs, keys, tables, uploads
from service.rows.database import once_committed


def test_what_is_committed_to_sqlite_outlasts_a_power_cut(engine: sa.Engine) -> None:
    with engine.connect() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar_one() == "wal"
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar_one() == 2  # FULL


def test_the_folder_of_a_new_database_is_made(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("data") / "new" / "folder" / "jobs.sqlite"
    engine = database.connect(f"sqlite:///{path}")
    tables.metadata.create_all(engine)
    engine.dispose()
    assert path.exists()
    assert path.parent.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_is_there_keeps_its_rights(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    database.connect(f"sqlite:///{tmp_path / 'jobs.sqlite'}").dispose()
    assert tmp_path.stat().st_mode & 0o777 == 0o755


def test_a_full_disk_is_told_from_a_database_that_is_away(tmp_path: Path) -> None:
    engine = database.connect(f"sqlite:///{tmp_path / 'jobs.sqlite'}")
    tables.metadata.create_all(engine)
    with engine.connect() as connection:
        connection.exec_driver_sql("PRAGMA max_page_count = 1")
        with pytest.raises(sa.exc.OperationalError) as caught:
            connection.exec_driver_sql("CREATE TABLE more AS SELECT zeroblob(100000)")
    engine.dispose()
    assert database.is_full(caught.value)
    assert database.is_full(sa.exc.OperationalError("x", None, psycopg.errors.DiskFull()))
    assert not database.is_full(sa.exc.OperationalError("x", None, psycopg.OperationalError()))
    opening = sqlite3.OperationalError("disk I/O error")
    opening.sqlite_errorcode = sqlite3.SQLITE_IOERR_SHMSIZE
    assert database.is_full(sa.exc.OperationalError("x", None, opening))


@pytest.mark.parametrize("fault", ["a commit that fails", "a connection that is lost"])
def test_nothing_is_called_for_what_is_not_kept(engine: sa.Engine, fault: str) -> None:
    called: list[str] = []
    with engine.begin() as connection:
        connection.exec_driver_sql(
            "CREATE TABLE known (id TEXT REFERENCES workers (id) DEFERRABLE INITIALLY DEFERRED)"
        )
        once_committed(connection, lambda: called.append("before"))
    with pytest.raises((sa.exc.IntegrityError, TimeoutError)), engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO known VALUES ('nobody')")
        once_committed(connection, lambda: called.append("meanwhile"))
        if fault == "a connection that is lost":
            connection.invalidate()
            raise TimeoutError
    with engine.begin() as connection:
        assert connection.exec_driver_sql("SELECT * FROM known").all() == []
        once_committed(connection, lambda: called.append("after"))
        assert called == ["before"]
    assert called == ["before", "after"]


@pytest.mark.parametrize("text", ["a\0b", "a\nb", "é", "\ud800"])
def test_what_no_database_takes_is_no_id(text: str, engine: sa.Engine) -> None:
    assert not database.may_be_id(text)
    assert database.may_be_id("8e03978e40d543ddbc936894a57f9324")
    with engine.begin() as connection:
        assert jobs.find(connection, text) is None
        assert cameras.address_of(connection, text) is None
        assert uploads.find(connection, "", text) is None
        assert uploads.remove(connection, "", [text]) is False
        assert keys.revoke(connection, text) is False
