from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

from service import database, jobs, sandbox
from service.api.context import Context
from service.attempt import FRAMES, Attempt, describe_inputs, inputs_key, results_key
from service.errors import CrashError
from service.states import State
from service.storage import Storage

Run = Callable[[], jobs.Job | None]


@pytest.fixture
def run(context: Context) -> Run:
    """Make one attempt at a job of two photographs; the job afterwards, None when deleted."""

    def attempt() -> jobs.Job | None:
        for frame in FRAMES:
            context.storage.put(inputs_key("a", frame), frame.encode())
        values: dict[str, Any] = {
            "id": "a",
            "options": {},
            "inputs": describe_inputs("a", dict.fromkeys(FRAMES, "")),
            "trace_id": "1" * 32,
            "request_hash": "",
        }
        with context.engine.begin() as connection:
            jobs.add(connection, values)
            held = jobs.claim(connection, "a", "w")
        assert held is not None
        Attempt(
            held,
            context.engine,
            context.storage,
            context.settings,
            context.fork_server,
            lambda: False,
        ).run()
        with context.engine.connect() as connection:
            return jobs.find(connection, "a")

    return attempt


def raising(error: Exception) -> Callable[..., None]:
    def fail(*_arguments: object) -> None:
        raise error

    return fail


@pytest.mark.parametrize(
    ("error", "kind"),
    [(GenericError("refused by the bucket"), "store-unavailable"), (OSError("full"), "internal")],
)
def test_what_the_user_cannot_mend_is_in_the_log_with_its_cause(
    error: Exception,
    kind: str,
    run: Run,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(Storage, "get_file", raising(error))
    job = run()
    assert job is not None
    assert job.state == State.FAILED
    assert job.error is not None
    assert job.error["type"] == f"urn:lightlayers:problem:{kind}"
    assert str(error) not in job.error["detail"]
    assert str(error) in caplog.text


def test_a_crash_of_the_separation_fails_the_job_with_its_reason(
    run: Run, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(sandbox, "run", raising(CrashError("It crashed.")))
    job = run()
    assert job is not None
    assert job.error is not None
    assert (job.error["status"], job.error["detail"]) == (500, "It crashed.")
    assert "Traceback" not in caplog.text


def test_results_are_stored_with_what_an_answer_needs(
    run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def separate(task: sandbox.Task, *_rest: object) -> None:
        folder = Path(task.directory)
        (folder / "results").mkdir()
        (folder / "results" / "a.png").write_bytes((folder / "no_flash").read_bytes()[::-1])

    monkeypatch.setattr(sandbox, "run", separate)
    job = run()
    assert job is not None
    assert job.state == State.SUCCEEDED
    assert job.results == [
        {
            "name": "a.png",
            "size": 8,
            "sha256": hashlib.sha256(b"hsalf_on").hexdigest(),
            "media_type": "image/png",
        }
    ]
    assert context.storage.get(results_key("a", 1, "a.png")) == b"hsalf_on"


def test_results_of_lost_attempts_go(
    run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def separate(task: sandbox.Task, *_rest: object) -> None:
        with context.engine.begin() as connection:
            connection.execute(sa.update(database.jobs).values(attempt=3))
        (Path(task.directory) / "results").mkdir()

    claim = jobs.claim

    def third(connection: sa.Connection, job_id: str, worker: str) -> jobs.Job | None:
        held = claim(connection, job_id, worker)
        return held and replace(held, attempt=3)

    monkeypatch.setattr(jobs, "claim", third)
    monkeypatch.setattr(sandbox, "run", separate)
    for lost in (1, 2):
        context.storage.put(results_key("a", lost, "a.png"), b"half")
    job = run()
    assert job is not None and job.state == State.SUCCEEDED
    assert context.storage.list("jobs/a/") == [inputs_key("a", frame) for frame in sorted(FRAMES)]


def test_progress_is_written_now_and_then(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[tuple[str, float]] = []

    def separate(task: sandbox.Task, _seconds: float, report: Any, *_rest: object) -> None:
        for stage in ("layers", "encode"):
            for step in range(1000):
                report(stage, step / 1000)
        (Path(task.directory) / "results").mkdir()

    monkeypatch.setattr(sandbox, "run", separate)
    monkeypatch.setattr(
        jobs,
        "report",
        lambda _connection, _job, stage, fraction, *_rest: written.append((stage, fraction)),
    )
    run()
    assert [written[0], written[-1][0]] == [("layers", 0.0), "encode"]
    assert ("encode", 0.0) in written
    assert len(written) < 100


def test_a_pair_that_was_captured_is_not_taken_again(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    kinds: list[str] = []

    def separate(task: sandbox.Task, *_rest: object) -> None:
        kinds.append(task.kind)
        (Path(task.directory) / "results").mkdir()

    claim = jobs.claim

    def captured(connection: sa.Connection, job_id: str, worker: str) -> jobs.Job | None:
        held = claim(connection, job_id, worker)
        return held and replace(held, capture={"camera": "sim://studio"})

    monkeypatch.setattr(jobs, "claim", captured)
    monkeypatch.setattr(sandbox, "run", separate)
    run()
    assert kinds == ["separate"]


def test_an_attempt_that_was_canceled_leaves_no_results(
    run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def separate(
        _task: sandbox.Task, _seconds: float, _report: object, must_stop: Any, *_rest: object
    ) -> None:
        context.storage.put(results_key("a", 1, "a.png"), b"half")
        with context.engine.begin() as connection:
            jobs.request_cancel(connection, "a")
        assert must_stop()
        raise sandbox.StoppedError

    monkeypatch.setattr(sandbox, "run", separate)
    job = run()
    assert job is not None
    assert job.state == State.CANCELED
    assert context.storage.list("jobs/a/") == [inputs_key("a", frame) for frame in sorted(FRAMES)]


def test_a_job_that_was_deleted_leaves_nothing_at_all(
    run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def separate(*_arguments: object) -> None:
        with context.engine.begin() as connection:
            jobs.remove(connection, "a")
        raise sandbox.StoppedError

    monkeypatch.setattr(sandbox, "run", separate)
    assert run() is None
    assert context.storage.list("jobs/") == []
