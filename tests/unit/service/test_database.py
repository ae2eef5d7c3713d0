from __future__ import annotations

import pytest
import sqlalchemy as sa

from service import database


def test_what_is_committed_to_sqlite_outlasts_a_power_cut(engine: sa.Engine) -> None:
    with engine.connect() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar_one() == "wal"
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar_one() == 2  # FULL


def test_the_folder_of_a_new_database_is_made(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("data") / "new" / "folder" / "jobs.sqlite"
    engine = database.connect(f"sqlite:///{path}")
    database.metadata.create_all(engine)
    engine.dispose()
    assert path.exists()
