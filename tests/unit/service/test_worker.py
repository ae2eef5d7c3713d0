from __future__ import annotations

import sqlite3
import threading
from collections.abc import Callable
from typing import Any

import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

from service import heartbeats, jobs, presence, worker
from service.attempt import FRAMES, Attempt, describe_inputs
from service.database import AWAY
from service.engine import Held
from service.settings import Settings
from service.states import State
from service.worker import Worker


@pytest.fixture
def one(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Worker:
    """A worker whose queue is the test."""
    monkeypatch.setattr(worker, "_RETRY_SECONDS", 0.01)
    return Worker(settings)


def _add(one: Worker, job_id: str) -> None:
    values: dict[str, Any] = {
        "id": job_id,
        "options": {},
        "inputs": describe_inputs(job_id, dict.fromkeys(FRAMES, "")),
        "trace_id": "1" * 32,
        "request_hash": "",
    }
    with one._engine.begin() as connection:
        jobs.add(connection, values)


def _find(one: Worker, job_id: str) -> jobs.Job:
    with one._engine.connect() as connection:
        job = jobs.find(connection, job_id)
    assert job is not None
    return job


def _ends(attempt: Attempt) -> None:
    with attempt._engine.begin() as connection:
        assert jobs.succeed(connection, attempt._job, [])


def _at_first(error: Exception, then: Callable[..., Any]) -> Callable[..., Any]:
    errors = [error]

    def work(*arguments: Any) -> Any:
        if errors:
            raise errors.pop()
        return then(*arguments)

    return work


@pytest.mark.parametrize(
    ("error", "lost"),
    [
        (sa.exc.OperationalError("", None, sqlite3.OperationalError("disk is full")), 0),
        (GenericError("the store is away"), 0),
        (ChildProcessError("the fork server has died"), 1),
        (KeyError("a fault of ours"), 1),
    ],
)
def test_whatever_cuts_an_attempt_short_another_follows(
    one: Worker, error: Exception, lost: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Raised to the queue, it would take the job out there, and leave its row running for ever."""
    monkeypatch.setattr(Attempt, "run", _at_first(error, _ends))
    _add(one, "a")
    one.run("a")
    job = _find(one, "a")
    assert (job.state, job.attempt, job.lost) == (State.SUCCEEDED, 2, lost)


def test_an_attempt_is_given_up_when_the_database_is_back(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    away = sa.exc.OperationalError("", None, sqlite3.OperationalError("away"))
    monkeypatch.setattr(Attempt, "run", _at_first(away, _ends))
    monkeypatch.setattr(Attempt, "give_up", _at_first(away, Attempt.give_up))
    _add(one, "a")
    one.run("a")
    assert _find(one, "a").state == State.SUCCEEDED


def test_a_claim_whose_answer_got_lost_is_made_again(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    claim = jobs.claim
    lost = [True]

    def claim_and_lose(_connection: sa.Connection, job_id: str, name: str) -> jobs.Job | None:
        with one._engine.begin() as connection:
            held = claim(connection, job_id, name)
        if lost:
            lost.pop()
            raise sa.exc.OperationalError("", None, sqlite3.OperationalError("away"))
        return held

    monkeypatch.setattr(jobs, "claim", claim_and_lose)
    monkeypatch.setattr(Attempt, "run", _ends)
    _add(one, "a")
    one._beat()
    one.run("a")
    job = _find(one, "a")
    assert (job.state, job.attempt, job.lost) == (State.SUCCEEDED, 2, 0)


def test_one_worker_runs_a_job_once_at_a_time(one: Worker, monkeypatch: pytest.MonkeyPatch) -> None:
    """The queue may bring it twice: what was taken over from a frozen worker may come back."""
    begun, go = threading.Event(), threading.Event()
    runs: list[int] = []

    def run(attempt: Attempt) -> None:
        runs.append(attempt._job.attempt)
        begun.set()
        assert go.wait(60)
        _ends(attempt)

    monkeypatch.setattr(Attempt, "run", run)
    _add(one, "a")
    threads = [threading.Thread(target=one.run, args=("a",)) for _ in range(2)]
    threads[0].start()
    assert begun.wait(60)
    threads[1].start()
    go.set()
    for thread in threads:
        thread.join()
    assert runs == [1]


def test_jobs_that_the_queue_forgot_to_bring_are_put_back(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_back: list[set[str]] = []
    held = [
        Held("mine", one.id, "jobs"),
        Held("running", one.id, "jobs"),
        Held("a sweep", one.id, "upkeep"),
        Held("dead", "another", "jobs"),
        Held("living", "neighbour", "jobs"),
    ]
    monkeypatch.setattr(one._queue, "held", lambda: held)
    monkeypatch.setattr(
        one._queue, "put_back", lambda found: put_back.append({held.id for held in found})
    )
    one._runs.add("running")
    with one._engine.begin() as connection:
        heartbeats.beat(connection, "neighbour")
    one.keep()
    one.keep()
    assert put_back == [{"dead"}, {"dead", "mine"}]


@pytest.mark.parametrize("error", AWAY)
def test_a_database_that_is_away_does_not_end_a_worker(
    one: Worker, error: type[sa.exc.DBAPIError], monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = error("", None, sqlite3.OperationalError("away"))
    monkeypatch.setattr(heartbeats, "beat", _at_first(gone, heartbeats.beat))
    one.keep()
    one.keep()
    with one._engine.begin() as connection:
        assert heartbeats.living(connection, 60) == {one.id}


def test_the_jobs_of_a_worker_that_died_on_this_machine_are_taken_over_at_once(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its silence is not waited for, as that of a worker elsewhere is."""
    monkeypatch.setattr(presence, "dead", lambda _folder: iter(["died-here"]))
    put_back: list[Held] = []
    held = [Held("a", "died-here", "jobs"), Held("b", "elsewhere", "jobs")]
    monkeypatch.setattr(one._queue, "held", lambda: held)
    monkeypatch.setattr(one._queue, "put_back", put_back.extend)
    with one._engine.begin() as connection:
        for name in ("died-here", "elsewhere"):
            heartbeats.beat(connection, name)
    one.keep()
    assert put_back == held[:1]
