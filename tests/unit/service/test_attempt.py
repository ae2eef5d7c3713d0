from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from obstore.exceptions import GenericError

from service import jobs, sandbox
from service.api.context import Context
from service.attempt import FRAMES, Attempt, describe_inputs, inputs_key, results_key
from service.errors import CrashError
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
        Attempt(held, context.engine, context.storage, context.settings, lambda: False).run()
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
    assert job.state == jobs.State.FAILED
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
    assert job.state == jobs.State.SUCCEEDED
    assert job.results == [
        {
            "name": "a.png",
            "size": 8,
            "sha256": hashlib.sha256(b"hsalf_on").hexdigest(),
            "media_type": "image/png",
        }
    ]
    assert context.storage.get(results_key("a", 1, "a.png")) == b"hsalf_on"


def test_an_attempt_that_was_canceled_leaves_no_results(
    run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def separate(_task: sandbox.Task, _seconds: float, _report: object, must_stop: Any) -> None:
        context.storage.put(results_key("a", 1, "a.png"), b"half")
        with context.engine.begin() as connection:
            jobs.request_cancel(connection, "a")
        assert must_stop()
        raise sandbox.StoppedError

    monkeypatch.setattr(sandbox, "run", separate)
    job = run()
    assert job is not None
    assert job.state == jobs.State.CANCELED
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
