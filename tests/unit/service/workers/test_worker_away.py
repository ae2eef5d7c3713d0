"""What a worker says of a database that goes away under it."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
import sqlalchemy as sa

from service.errors import StartError
from service.rows import jobs
from service.settings import Settings
from service.workers import worker
from service.workers.worker import Worker
from tests.unit.service.at_first import raising

_AWAY = sa.exc.OperationalError("SELECT 1", {}, Exception("connection failed: refused\nDETAIL: x"))


@pytest.fixture
def one(settings: Settings) -> Iterator[Worker]:
    """A worker that has not begun."""
    one = Worker(settings)
    yield one
    one._engine.dispose()


def test_a_database_that_goes_while_a_worker_starts_is_told_in_a_line(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(one._fork_server, "start", lambda: None)
    monkeypatch.setattr(worker, "launch", raising(_AWAY))
    with pytest.raises(StartError) as caught:
        one.serve(threading.Event())
    assert str(caught.value) == (
        "The database of jobs went away while the worker started: start it, or check "
        "LIGHTLAYERS_DATABASE_URL (connection failed: refused)."
    )


def test_a_job_without_a_database_is_a_line_for_each_time_that_it_goes(
    one: Worker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    fault = RuntimeError("what?")
    # None: another worker has it
    found: list[Exception | None] = [_AWAY, _AWAY, fault, _AWAY, None, _AWAY, _AWAY, None]

    def claim(*_arguments: object) -> None:
        if error := found.pop(0):
            raise error

    monkeypatch.setattr(worker, "_RETRY_SECONDS", 0.0)
    monkeypatch.setattr(jobs, "find", lambda *_arguments: object())
    assert one._run("1", claim, lambda *_arguments: not found)
    away = "cut short, database-unavailable: connection failed: refused"
    assert [line.getMessage() for line in caplog.records] == [away, "cut short", away]
