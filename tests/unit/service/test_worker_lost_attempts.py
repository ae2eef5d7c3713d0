from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import sqlalchemy as sa

from service import database, jobs, worker
from service.attempt import FRAMES, Attempt, describe_inputs, inputs_key
from service.settings import Settings
from service.states import State
from service.worker import Worker

CUT_SHORT = {
    "its process died": ChildProcessError("the fork server has died"),
    "the pool was empty": sa.exc.TimeoutError("no connection"),
    "something nobody thought of": RuntimeError("what?"),
}


@pytest.fixture
def one(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Iterator[Worker]:
    """A worker that lives, and does not wait before it tries again."""
    monkeypatch.setattr(worker, "_RETRY_SECONDS", 0.0)
    one = Worker(settings)
    one.keep()
    yield one
    one._engine.dispose()


def _add(one: Worker, **values: Any) -> None:
    row = {
        "id": "a",
        "options": {},
        "inputs": describe_inputs("a", dict.fromkeys(FRAMES, "")),
        "trace_id": "1" * 32,
        "request_hash": "",
    }
    for frame in FRAMES:
        one._storage.put(inputs_key("a", frame), b"light")
    with one._engine.begin() as connection:
        rank = jobs.add(connection, row | values)
        one._queue.submit(connection, "a", rank)


def _find(one: Worker) -> jobs.Job:
    with one._engine.connect() as connection:
        job = jobs.find(connection, "a")
    assert job is not None
    return job


@pytest.mark.parametrize("how", CUT_SHORT)
def test_attempts_that_are_cut_short_are_bounded(
    how: str, one: Worker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    attempts: list[int] = []

    def work(attempt: Attempt) -> bool:
        attempts.append(attempt._job.attempt)
        raise CUT_SHORT[how]

    monkeypatch.setattr(Attempt, "run", work)
    _add(one)
    one.run("a")
    assert attempts == [1, 2, 3]
    job = _find(one)
    assert (job.state, job.lost) == (State.FAILED, 3)
    assert job.error is not None
    assert job.error["type"] == "urn:lightlayers:problem:abandoned"
    assert "cut short 3 times" in job.error["detail"]
    assert str(CUT_SHORT[how]) in caplog.text


def test_a_job_that_was_cut_short_once_succeeds(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work(attempt: Attempt) -> None:
        if attempt._job.attempt == 1:
            raise CUT_SHORT["its process died"]
        with one._engine.begin() as connection:
            assert jobs.succeed(connection, attempt._job, [])

    monkeypatch.setattr(Attempt, "run", work)
    _add(one)
    one.run("a")
    job = _find(one)
    assert (job.state, job.attempt, job.lost) == (State.SUCCEEDED, 2, 1)


def test_an_attempt_that_is_cut_short_while_it_is_canceled_ends_so(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work(_attempt: Attempt) -> None:
        with one._engine.begin() as connection:
            jobs.request_cancel(connection, "a")
        raise CUT_SHORT["its process died"]

    monkeypatch.setattr(Attempt, "run", work)
    _add(one)
    one.run("a")
    assert _find(one).state == State.CANCELED


@pytest.mark.parametrize("seen", ["by its heartbeat", "when it takes the job"])
def test_a_job_that_waits_past_its_deadline_fails(seen: str, one: Worker) -> None:
    _add(one, deadline=1.0)
    if seen == "by its heartbeat":
        one.keep()
    else:
        one.run("a")
    job = _find(one)
    assert (job.state, job.results) == (State.FAILED, None)
    assert job.error is not None
    assert job.error["type"] == "urn:lightlayers:problem:deadline-passed"
    assert (job.error["retryable"], job.error["trace_id"]) == (True, "1" * 32)


def test_a_heartbeat_outlives_what_breaks_it(
    one: Worker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail() -> list[str]:
        raise RuntimeError("no such workflow")

    with monkeypatch.context() as broken:
        broken.setattr(one._queue, "held", fail)
        one.keep()
    assert "no such workflow" in caplog.text
    with one._engine.begin() as connection:
        connection.execute(sa.delete(database.workers))
    one.keep()
    with one._engine.connect() as connection:
        assert connection.execute(sa.select(database.workers.c.id)).scalars().all() == [one.id]
