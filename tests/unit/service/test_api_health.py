from __future__ import annotations

import httpx
import pytest
import sqlalchemy as sa

from service import database, heartbeats
from service.api.context import Context
from tests.unit.service.asking import problem_of


@pytest.fixture(autouse=True)
def _worker(context: Context) -> None:
    with context.engine.begin() as connection:
        heartbeats.beat(connection, "w")


def _not_ready(http: httpx.Client) -> str:
    assert http.get("/healthz").status_code == 200
    status, kind, detail = problem_of(http.get("/readyz"))
    assert (status, kind) == (503, "service-not-ready")
    return detail


def test_a_healthy_service_says_so(http: httpx.Client) -> None:
    assert http.get("/healthz").json() == {"status": "ok"}
    assert http.get("/readyz").json() == {"status": "ok"}


def test_a_service_without_its_store_is_alive_but_not_ready(
    http: httpx.Client, context: Context
) -> None:
    store = context.settings.data_dir / "store"
    store.rmdir()
    store.write_bytes(b"no folder")
    assert _not_ready(http) == "The service is not ready: the store of photographs does not answer."


def test_a_service_whose_worker_is_silent_is_not_ready(
    http: httpx.Client, context: Context
) -> None:
    with context.engine.begin() as connection:
        connection.execute(sa.update(database.workers).values(seen=database.workers.c.seen - 100))
    assert "no worker lives, so start one" in _not_ready(http)


def test_a_service_without_its_database_is_not_ready(http: httpx.Client, context: Context) -> None:
    with context.engine.begin() as connection:
        connection.exec_driver_sql("ALTER TABLE workers RENAME TO gone")
    assert _not_ready(http) == "The service is not ready: the database of jobs does not answer."


def test_a_service_that_was_told_to_stop_is_not_ready(
    http: httpx.Client, context: Context, caplog: pytest.LogCaptureFixture
) -> None:
    context.draining.set()
    caplog.set_level("INFO", "service.api")
    assert _not_ready(http) == "The service is not ready: it was told to stop."
    (said,) = [record for record in caplog.records if record.name == "service.api"]
    assert said.getMessage() == "The service is not ready: it was told to stop."
    assert (said.levelname, said.exc_info) == ("INFO", None)  # nothing is wrong
