from __future__ import annotations

import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import httpx
import pytest
import sqlalchemy as sa
from fastapi import FastAPI

from service.api import health
from service.api.context import Context
from service.rows import heartbeats, tables
from service.storage.by_url import storage_at
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


def test_who_watches_may_ask_without_a_body(http: httpx.Client, context: Context) -> None:
    def asked(path: str) -> tuple[int, bytes]:
        answer = http.head(path)
        return answer.status_code, answer.content

    assert (asked("/healthz"), asked("/readyz")) == ((200, b""), (200, b""))
    context.draining.set()
    assert (asked("/healthz"), asked("/readyz")) == ((200, b""), (503, b""))


def test_a_service_without_its_store_is_alive_but_not_ready(
    http: httpx.Client, context: Context
) -> None:
    store = context.settings.data_dir / "store"
    store.rmdir()
    store.write_bytes(b"no folder")
    assert _not_ready(http) == "The service is not ready: the store of photographs does not answer."


def test_a_service_whose_disk_is_full_is_ready_to_have_jobs_deleted(
    http: httpx.Client, context: Context, server: tuple[FastAPI, str]
) -> None:
    app, _ = server
    full = context.settings.model_copy(update={"free_bytes": 2**62})
    app.state.context = replace(context, settings=full)
    assert problem_of(http.post("/jobs"))[:2] == (507, "storage-full")
    assert http.get("/readyz").status_code == 200


def test_a_store_that_hangs_is_told_soon(
    http: httpx.Client,
    context: Context,
    server: tuple[FastAPI, str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(health, "_ANSWER_SECONDS", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{silent.getsockname()[1]}")
        monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
        monkeypatch.setenv("AWS_SKIP_SIGNATURE", "true")
        server[0].state.context = replace(context, storage=storage_at("s3://photographs"))
        assert "the store of photographs does not answer" in _not_ready(http)


def test_a_database_that_hangs_is_not_waited_for(
    http: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also not once all the threads hang that look for it."""
    back = threading.Event()

    def hang(_: Context) -> int:
        back.wait()
        return 1

    monkeypatch.setattr(health, "_ANSWER_SECONDS", 0.2)
    monkeypatch.setattr(health, "_living_workers", hang)
    try:
        told = [_not_ready(http) for _ in range(8)]
    finally:
        back.set()
    assert set(told) == {"The service is not ready: the database of jobs does not answer."}


def test_the_process_answers_whatever_its_threads_wait_for(
    http: httpx.Client, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken, go_on = threading.Semaphore(0), threading.Event()

    def wait(_context: Context) -> int:
        taken.release()
        go_on.wait(120)
        return 1

    monkeypatch.setattr(health, "_living_workers", wait)
    with ThreadPoolExecutor(50) as pool:
        asked = [pool.submit(http.get, "/readyz", timeout=60) for _ in range(50)]
        try:
            for _ in range(int(context.probing.total_tokens)):
                assert taken.acquire(timeout=60)
            assert http.get("/healthz", timeout=60).status_code == 200
            assert http.get("/jobs", timeout=60).status_code == 200  # by a thread of routes
            assert not taken.acquire(blocking=False)
            assert {each.result().status_code for each in asked} == {503}
        finally:
            go_on.set()


def test_a_service_whose_worker_is_silent_is_not_ready(
    http: httpx.Client, context: Context
) -> None:
    with context.engine.begin() as connection:
        connection.execute(sa.update(tables.workers).values(seen=tables.workers.c.seen - 100))
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
