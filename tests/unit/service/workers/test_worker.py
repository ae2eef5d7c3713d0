from __future__ import annotations

import json
import os
import socket
import sqlite3
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

from service import metrics
from service.object_keys import results_key
from service.rows import attempts, cameras, jobs, tables
from service.rows.states import State
from service.workers import worker
from service.workers.attempt import Attempt
from service.workers.outcome import Outcome
from service.workers.worker import Worker
from tests.unit.service.at_first import at_first
from tests.unit.service.job_rows import added_pair

CUT_SHORT = {
    "its process died": ChildProcessError("the fork server has died"),
    "something nobody thought of": RuntimeError("what?"),
}


def _find(one: Worker) -> jobs.Job:
    with one._engine.connect() as connection:
        job = jobs.find(connection, "a")
    assert job is not None
    return job


def _ends(attempt: Attempt, *_pass_on: object) -> None:
    with attempt._means.engine.begin() as connection:
        assert attempts.succeed(connection, attempt._job, [])


@pytest.mark.parametrize(
    ("error", "lost"),
    [
        (sa.exc.OperationalError("", None, sqlite3.OperationalError("disk is full")), 0),
        (sa.exc.TimeoutError("all connections to the database are in use"), 0),
        (GenericError("the store is away"), 0),
        (ChildProcessError("the fork server has died"), 1),
        (KeyError("a fault of ours"), 1),
    ],
)
def test_whatever_cuts_an_attempt_short_another_follows(
    one: Worker, error: Exception, lost: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Raised to the queue, it would take the job out there, and leave its row running for ever."""
    monkeypatch.setattr(Attempt, "run", at_first(error, _ends))
    added_pair(one._engine)
    one.run("a")
    job = _find(one)
    assert (job.state, job.attempt, job.lost) == (State.SUCCEEDED, 2, lost)


def test_a_stop_waits_for_a_job_that_is_just_being_claimed(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its row would stay running, and wait for a worker that finds this one dead."""
    monkeypatch.setattr(worker, "launch", lambda *_: None)
    monkeypatch.setattr(metrics, "serve", lambda *_: None)
    monkeypatch.setattr(one._fork_server, "start", lambda: None)
    monkeypatch.setattr(Attempt, "run", _ends)
    stop = threading.Event()
    serving = threading.Thread(target=one.serve, args=(stop,))
    left: list[bool] = []

    def claim(*arguments: Any) -> jobs.Job | None:
        stop.set()
        serving.join(timeout=1.5)  # longer than what it waits for between two heartbeats
        left.append(not serving.is_alive())
        return attempts.claim(*arguments)

    one._settings = one._settings.model_copy(update={"heartbeat_seconds": 0.1})
    added_pair(one._engine)
    serving.start()
    wanted = ("a", claim, lambda _connection, job: job.ended)
    threading.Thread(target=one._run, args=wanted, daemon=True).start()  # it never returns
    serving.join()
    assert left == [False]
    assert _find(one).state == State.SUCCEEDED


def test_no_job_begins_once_a_stop_has(one: Worker) -> None:
    added_pair(one._engine)
    one._in_hand.stop(0.0)
    thread = threading.Thread(target=one.run, args=("a",), daemon=True)  # it never returns
    thread.start()
    thread.join(timeout=0.5)
    assert thread.is_alive()
    assert _find(one).state == State.QUEUED


@pytest.mark.parametrize("how", CUT_SHORT)
def test_attempts_that_are_cut_short_are_bounded(
    how: str, one: Worker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    begun: list[int] = []

    def work(attempt: Attempt, *_pass_on: object) -> bool:
        begun.append(attempt._job.attempt)
        raise CUT_SHORT[how]

    monkeypatch.setattr(Attempt, "run", work)
    added_pair(one._engine)
    for lost in (1, 2, 3):  # whose worker had no time to remove them
        one._storage.put(results_key("a", lost, "a.png"), b"half")
    monkeypatch.setattr(Outcome, "_clear", lambda *_arguments: None)
    one.run("a")
    assert one._storage.list("jobs/") == []
    assert begun == [1, 2, 3]
    job = _find(one)
    assert (job.state, job.lost) == (State.FAILED, 3)
    assert job.error is not None
    assert job.error["type"] == "urn:lightlayers:problem:abandoned"
    assert "cut short 3 times" in job.error["detail"]
    assert str(CUT_SHORT[how]) in caplog.text


def test_attempts_are_bounded_though_the_database_is_away_whenever_one_was_cut_short(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where what kills them fills the memory or the disk of both."""
    begun: list[int] = []
    away: list[sa.exc.OperationalError] = []
    give_up = Outcome.give_up

    def work(attempt: Attempt, *_pass_on: object) -> None:
        begun.append(attempt._job.attempt)
        if len(begun) > 3:  # else it went on for ever
            _ends(attempt)
            return
        away.append(sa.exc.OperationalError("", None, sqlite3.OperationalError("away")))
        raise CUT_SHORT["its process died"]

    def give_up_later(outcome: Outcome, lost: bool = False) -> None:
        if away:
            raise away.pop()
        give_up(outcome, lost)

    monkeypatch.setattr(Attempt, "run", work)
    monkeypatch.setattr(Outcome, "give_up", give_up_later)
    added_pair(one._engine)
    one.run("a")
    assert begun == [1, 2, 3]
    job = _find(one)
    assert (job.state, job.lost) == (State.FAILED, 3)


def test_an_attempt_that_is_cut_short_while_it_is_canceled_ends_so(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work(_attempt: Attempt, *_pass_on: object) -> None:
        with one._engine.begin() as connection:
            jobs.request_cancel(connection, "a")
        raise CUT_SHORT["its process died"]

    monkeypatch.setattr(Attempt, "run", work)
    added_pair(one._engine)
    one.run("a")
    assert _find(one).state == State.CANCELED


@pytest.mark.parametrize("seen", ["by its heartbeat", "when it takes the job"])
def test_a_job_that_waits_past_its_deadline_fails(seen: str, one: Worker) -> None:
    added_pair(one._engine, deadline=1.0)
    if seen == "by its heartbeat":
        one.upkeep.keep()
    else:
        one.run("a")
    job = _find(one)
    assert (job.state, job.results) == (State.FAILED, None)
    assert job.error is not None
    assert job.error["type"] == "urn:lightlayers:problem:deadline-passed"
    assert (job.error["retryable"], job.error["trace_id"]) == (True, "1" * 32)


def test_an_attempt_is_given_up_when_the_database_is_back(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    away = sa.exc.OperationalError("", None, sqlite3.OperationalError("away"))
    monkeypatch.setattr(Attempt, "run", at_first(away, _ends))
    monkeypatch.setattr(Outcome, "give_up", at_first(away, Outcome.give_up))
    added_pair(one._engine)
    one.run("a")
    assert _find(one).state == State.SUCCEEDED


def test_a_claim_whose_answer_got_lost_is_made_again(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    claim = attempts.claim
    lost = [True]

    def claim_and_lose(_connection: sa.Connection, job_id: str, name: str) -> jobs.Job | None:
        with one._engine.begin() as connection:
            held = claim(connection, job_id, name)
        if lost:
            lost.pop()
            raise sa.exc.OperationalError("", None, sqlite3.OperationalError("away"))
        return held

    monkeypatch.setattr(attempts, "claim", claim_and_lose)
    monkeypatch.setattr(Attempt, "run", _ends)
    added_pair(one._engine)
    one.run("a")
    job = _find(one)
    assert (job.state, job.attempt, job.lost) == (State.SUCCEEDED, 2, 0)


def test_one_worker_runs_a_job_once_at_a_time(one: Worker, monkeypatch: pytest.MonkeyPatch) -> None:
    """The queue may bring it twice: what was taken over from a frozen worker may come back."""
    begun, go = threading.Event(), threading.Event()
    runs: list[int] = []

    def run(attempt: Attempt, *_pass_on: object) -> None:
        runs.append(attempt._job.attempt)
        begun.set()
        assert go.wait(60)
        _ends(attempt)

    monkeypatch.setattr(Attempt, "run", run)
    added_pair(one._engine)
    threads = [threading.Thread(target=one.run, args=("a", again)) for again in range(2)]
    threads[0].start()
    assert begun.wait(60)
    threads[1].start()
    go.set()
    for thread in threads:
        thread.join()
    assert runs == [1]


def test_a_pair_that_was_kept_but_not_passed_on_goes_into_the_queue_of_jobs(one: Worker) -> None:
    """As after an attempt that its worker's end or a dead process cut short in between."""
    with one._engine.begin() as connection:
        camera = cameras.add(connection, "sim://studio")
    added_pair(one._engine, camera=camera, capture={"camera": "sim://studio"})
    assert not _queued(one)
    one.capture("a")
    one.capture("a")  # and once
    assert _queued(one) == ["a"]


@pytest.fixture
def told_off(one: Worker, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Orders by which the worker's switch of a flash was told off."""
    told: list[str] = []
    one._settings = one._settings.model_copy(update={"flash_switch": "relay {state}"})
    monkeypatch.setattr("drivers.leave_flash_off", told.append)
    return told


def _capturing(one: Worker, worker: str) -> None:
    """Have a worker take the pair of a job, with the flash on the operator's switch."""
    capture = {"camera": "sim://studio", "flash": "external"}
    with one._engine.begin() as connection:
        camera = cameras.add(connection, "sim://studio")
    added_pair(one._engine, camera=camera, capture=capture, inputs=None)
    with one._engine.begin() as connection:
        assert cameras.claim(connection, "a", worker)


@pytest.mark.parametrize("flash", ["external", "property", None])
def test_the_flash_of_a_job_that_is_gone_is_left_off_unless_another_job_has_its_switch(
    flash: str | None, one: Worker, told_off: list[str]
) -> None:
    if flash:
        _capturing(one, one.id)
        with one._engine.begin() as connection:
            capture = {"camera": "sim://studio", "flash": flash}
            connection.execute(sa.update(tables.jobs).values(capture=capture))
    one.capture("gone")
    assert told_off == ([] if flash == "external" else ["relay {state}"])


@pytest.mark.parametrize("end", [State.CANCELED, State.FAILED])
def test_the_flash_of_a_capture_whose_worker_died_is_left_off_though_no_attempt_follows(
    end: State, one: Worker, told_off: list[str]
) -> None:
    _capturing(one, "dead")
    with one._engine.begin() as connection:
        if end == State.CANCELED:
            jobs.request_cancel(connection, "a")
        else:
            connection.execute(sa.update(tables.jobs).values(lost=attempts.LOST_ATTEMPTS - 1))
    one.capture("a")
    assert (_find(one).state, told_off) == (end, ["relay {state}"])


def _queued(one: Worker) -> list[str]:
    with one._engine.connect() as connection:
        rows = connection.exec_driver_sql("SELECT workflow_uuid FROM workflow_status")
        return [row[0] for row in rows]


def test_a_worker_that_cannot_start_says_so_in_one_line_of_the_log(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        settings = {"DATA_DIR": str(tmp_path), "METRICS_PORT": str(other.getsockname()[1])}
        given = {f"LIGHTLAYERS_{name}": text for name, text in settings.items()}
        command = [sys.executable, "-m", "service.workers.worker"]
        done = subprocess.run(
            command, env=os.environ | given, capture_output=True, text=True, check=False
        )
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2
    assert "set another LIGHTLAYERS_METRICS_PORT" in json.loads(line)["message"]
