from __future__ import annotations

import errno
import hashlib
import logging
import sqlite3
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

from service.api.context import Context
from service.errors import CrashError, NoProcessError, StorageFullError
from service.frames import FRAMES
from service.object_keys import inputs_key, results_key
from service.rows import attempts, expiry, jobs, tables
from service.rows.states import State
from service.settings import Settings
from service.storage.base import Storage
from service.storage.folder import FolderStorage
from service.workers import kept_file, sandbox
from service.workers.stopping import Stopping
from service.workers.tasks import RESULTS, Task
from tests.unit.service.asking import stored
from tests.unit.service.at_first import at_first, raising
from tests.unit.service.attempts import attempt_at, attempt_once

Run = Callable[[], jobs.Job | None]


@pytest.fixture
def settings(settings: Settings) -> Settings:
    """Those of a job that waits for nothing."""
    return settings.model_copy(update={"patience_seconds": 0.0})


@pytest.fixture
def run(context: Context) -> Run:
    """Make one attempt at a job of two photographs; the job afterwards, None when deleted."""
    return partial(attempt_once, context)


@pytest.mark.parametrize(
    ("error", "kind", "is_ours"),
    [
        (GenericError("refused by the bucket"), "store-unavailable", False),
        (OSError("broken"), "internal", True),
    ],
)
def test_what_the_user_cannot_mend_is_in_the_log_with_its_cause(
    error: Exception,
    kind: str,
    is_ours: bool,
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
    (line,) = (each for each in caplog.records if each.levelno == logging.ERROR)
    assert str(error) in caplog.text
    assert bool(line.exc_info) == is_ours  # a trace is of what is a fault of the program alone


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
    def separate(task: Task, *_rest: object) -> None:
        folder = Path(task.directory)
        (folder / RESULTS).mkdir()
        (folder / RESULTS / "a.png").write_bytes((folder / "no_flash").read_bytes()[::-1])

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


@pytest.mark.parametrize("end", [State.SUCCEEDED, State.FAILED, State.CANCELED])
def test_results_of_lost_attempts_go_however_the_job_ends(
    run: Run, context: Context, end: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work(task: Task, *_rest: object) -> None:
        if end == State.FAILED:
            raise CrashError("It crashed.")
        if end == State.CANCELED:
            with context.engine.begin() as connection:
                jobs.request_cancel(connection, "a")
            raise sandbox.StoppedError
        separates(task)

    claim = attempts.claim

    def third(connection: sa.Connection, job_id: str, worker: str) -> jobs.Job | None:
        held = claim(connection, job_id, worker)
        connection.execute(sa.update(tables.jobs).values(attempt=3))
        return held and replace(held, attempt=3)

    monkeypatch.setattr(attempts, "claim", third)
    monkeypatch.setattr(sandbox, "run", work)
    for lost in (1, 2):
        context.storage.put(results_key("a", lost, "a.png"), b"half")
    job = run()
    assert job is not None and job.state == end
    kept = [results_key("a", 3, "a.png")] if end == State.SUCCEEDED else []
    kept += [inputs_key("a", frame) for frame in sorted(FRAMES)]
    assert context.storage.list("jobs/a/") == kept


def test_progress_is_written_now_and_then(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[tuple[str, float]] = []

    def separate(task: Task, report: Any, *_rest: object) -> None:
        for stage in ("layers", "encode"):
            for step in range(1000):
                report(stage, step / 1000)
        (Path(task.directory) / RESULTS).mkdir()

    monkeypatch.setattr(sandbox, "run", separate)
    monkeypatch.setattr(
        attempts,
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

    def separate(task: Task, *_rest: object) -> None:
        kinds.append(task.kind)
        (Path(task.directory) / RESULTS).mkdir()

    claim = attempts.claim

    def captured(connection: sa.Connection, job_id: str, worker: str) -> jobs.Job | None:
        held = claim(connection, job_id, worker)
        return held and replace(held, capture={"camera": "sim://studio"})

    monkeypatch.setattr(attempts, "claim", captured)
    monkeypatch.setattr(sandbox, "run", separate)
    run()
    assert kinds == ["separate"]


@pytest.mark.parametrize(
    ("options", "for_ever"),
    [
        ({"setup": "desk"}, False),
        ({"kind": "flash"}, False),
        ({"kind": "flash", "setup": "desk"}, True),
    ],
)
def test_calibrations_for_a_setup_alone_are_kept_for_ever(
    options: dict[str, Any], for_ever: bool, context: Context
) -> None:
    values = {"id": "a", "options": options, "trace_id": "1" * 32, "request_hash": ""}
    with context.engine.begin() as connection:
        jobs.add(connection, values)
        held = attempts.claim(connection, "a", "w")
    settings = context.settings.model_copy(update={"retention_days": 2.0})
    attempt = attempt_at(held, context, settings)
    assert attempt.outcome.fail({"type": "urn:lightlayers:problem:internal"})
    ended = stored(context.engine, "a")
    assert ended.finished is not None
    kept_until = ended.expires and round(ended.expires - ended.finished)
    assert kept_until == (None if for_ever else 2 * 86400)


def test_an_attempt_that_was_canceled_leaves_no_results(
    run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def separate(_task: Task, _report: object, must_stop: Any, *_rest: object) -> None:
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
            expiry.remove(connection, "a")
        raise sandbox.StoppedError

    monkeypatch.setattr(sandbox, "run", separate)
    assert run() is None
    assert context.storage.list("jobs/") == []


def test_a_job_that_is_deleted_while_it_begins_is_no_fault(
    run: Run,
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def gone(*_arguments: object) -> None:
        with context.engine.begin() as connection:
            expiry.remove(connection, "a")
        raise FileNotFoundError

    monkeypatch.setattr(Storage, "get_file", gone)
    assert run() is None
    assert "failed" not in caplog.text


@pytest.fixture
def patient(context: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have attempts try again, at once."""
    monkeypatch.setitem(context.settings.__dict__, "patience_seconds", 300.0)
    monkeypatch.setattr(Stopping, "pause", lambda _stopping, _seconds: None)


def separates(task: Task, *_rest: object) -> None:
    """Take the place of sandbox.run: one result."""
    folder = Path(task.directory) / RESULTS
    folder.mkdir()
    (folder / "a.png").write_bytes(b"result")


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize(
    ("owner", "name", "error"),
    [
        *product(
            [Storage],
            ["get_file", "put_file", "flush"],
            [GenericError("away"), OSError(errno.ENOSPC, "full")],
        ),
        (tempfile, "mkdtemp", OSError(errno.ENOSPC, "full")),
        (kept_file, "write", OSError(errno.ENOSPC, "full")),
    ],
)
def test_what_is_away_or_full_for_a_moment_costs_no_job(
    owner: object, name: str, error: Exception, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sandbox, "run", separates)
    monkeypatch.setattr(owner, name, at_first(error, getattr(owner, name)))
    job = run()
    assert job is not None
    assert (job.state, job.attempt) == (State.SUCCEEDED, 1)


def test_a_job_that_fails_leaves_no_results(
    run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk fills up with the second one."""
    put_file = Storage.put_file

    def put(storage: Storage, key: str, path: Path, *more: Any) -> str:
        if path.name == "b.png":
            raise OSError(errno.ENOSPC, "full")
        return put_file(storage, key, path, *more)

    def separates_more(task: Task, *_rest: object) -> None:
        separates(task)
        (Path(task.directory) / RESULTS / "b.png").write_bytes(b"result")

    monkeypatch.setattr(sandbox, "run", separates_more)
    monkeypatch.setattr(Storage, "put_file", put)
    job = run()
    assert job is not None and job.state == State.FAILED
    assert context.storage.list("") == sorted(inputs_key("a", frame) for frame in FRAMES)


@pytest.mark.usefixtures("patient")
def test_a_disk_that_is_full_for_a_moment_costs_no_job(
    run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_half(task: Task, *_rest: object) -> None:
        separates(task)
        monkeypatch.setattr(sandbox, "run", separates)
        raise StorageFullError("The disk is full.")

    monkeypatch.setattr(sandbox, "run", write_half)
    job = run()
    assert job is not None and job.state == State.SUCCEEDED
    assert context.storage.get(results_key("a", 1, "a.png")) == b"result"


@pytest.mark.usefixtures("patient")
def test_a_machine_without_processes_for_a_moment_costs_no_job(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sandbox, "run", at_first(NoProcessError(), separates))
    job = run()
    assert job is not None
    assert (job.state, job.attempt) == (State.SUCCEEDED, 1)


def test_a_machine_that_stays_without_processes_fails_the_job_with_that_reason(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sandbox, "run", raising(NoProcessError()))
    job = run()
    assert job is not None and job.error is not None
    assert job.error["type"] == "urn:lightlayers:problem:no-process"
    assert job.error["retryable"] is True


@pytest.mark.parametrize(
    ("module", "name", "error"),
    [
        (sandbox, "run", StorageFullError("The disk is full.")),
        (tempfile, "mkdtemp", OSError(errno.ENOSPC, "full")),
        (Storage, "get_file", OSError(errno.EDQUOT, "full")),
    ],
)
def test_a_disk_that_stays_full_fails_the_job_with_that_reason(
    module: object,
    name: str,
    error: Exception,
    run: Run,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(module, name, raising(error))
    job = run()
    assert job is not None and job.error is not None
    assert job.error["type"] == "urn:lightlayers:problem:storage-full"
    assert job.error["retryable"] is True
    (line,) = (each for each in caplog.records if each.levelno == logging.ERROR)
    assert "failed, storage-full: " in line.getMessage()
    assert not line.exc_info


def test_results_outlast_a_power_cut_before_the_job_has_succeeded(
    run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    flushed: dict[str, State] = {}

    def flush(_storage: Storage, keys: list[str]) -> None:
        with context.engine.connect() as connection:
            job = jobs.find(connection, "a")
        assert job is not None
        flushed.update(dict.fromkeys(keys, job.state))

    monkeypatch.setattr(sandbox, "run", separates)
    monkeypatch.setattr(FolderStorage, "flush", flush)
    run()
    assert flushed == {results_key("a", 1, "a.png"): State.RUNNING}


def test_what_cannot_be_cleared_does_not_cost_the_results(
    run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    claim = attempts.claim

    def second(connection: sa.Connection, job_id: str, worker: str) -> jobs.Job | None:
        claim(connection, job_id, worker)
        return claim(connection, job_id, worker)

    monkeypatch.setattr(attempts, "claim", second)
    monkeypatch.setattr(sandbox, "run", separates)
    delete = FolderStorage.delete_below
    away = at_first(GenericError("away"), delete)
    monkeypatch.setattr(FolderStorage, "delete_below", away)
    job = run()
    assert job is not None
    assert (job.state, job.attempt) == (State.SUCCEEDED, 2)
    assert context.storage.get(results_key("a", 2, "a.png")) == b"result"


def away() -> sa.exc.OperationalError:
    return sa.exc.OperationalError("", None, sqlite3.OperationalError("the database is away"))


BUSY = sa.exc.TimeoutError("all connections are in use")


@pytest.mark.parametrize("error", [away(), BUSY])
def test_an_attempt_without_a_database_is_cut_short_and_fails_no_job(
    error: Exception, run: Run, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.rows.kept.for_separation", raising(error))
    with pytest.raises(type(error)):
        run()
    with context.engine.connect() as connection:
        job = jobs.find(connection, "a")
    assert job is not None
    assert (job.state, job.attempt, job.error) == (State.RUNNING, 1, None)


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("end", ["succeed", "fail"])
def test_an_end_whose_answer_is_lost_is_written_once(
    run: Run,
    context: Context,
    end: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The database has it, but what it says to that does not come through."""
    caplog.set_level(logging.INFO, "service.workers.attempt")
    write, lost = getattr(attempts, end), [True]

    def write_and_lose(connection: sa.Connection, *arguments: Any, **more: Any) -> bool:
        if not lost:
            counts: bool = write(connection, *arguments, **more)
            return counts
        lost.pop()
        with context.engine.begin() as other:
            assert write(other, *arguments, **more)
        raise away()

    monkeypatch.setattr(attempts, end, write_and_lose)
    monkeypatch.setattr(
        sandbox, "run", separates if end == "succeed" else raising(CrashError("It crashed."))
    )
    job = run()
    assert job is not None and not lost
    stored = [key for key in context.storage.list("jobs/a/") if "/inputs/" not in key]
    told = caplog.records[-1].getMessage()
    if end == "succeed":
        assert (job.state, stored) == (State.SUCCEEDED, [results_key("a", 1, "a.png")])
        assert told == "succeeded"
    else:
        assert (job.state, stored) == (State.FAILED, [])
        assert told == "failed: urn:lightlayers:problem:crashed"


@pytest.mark.parametrize("error", [away(), BUSY])
@pytest.mark.parametrize(("silence", "goes_on"), [(3600.0, True), (0.0, False)])
def test_work_goes_on_without_a_database_until_others_take_it_over(
    silence: float,
    goes_on: bool,
    error: Exception,
    run: Run,
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def separate(task: Task, report: Any, must_stop: Any, *_rest: object) -> None:
        with monkeypatch.context() as patch:
            patch.setattr(attempts, "must_stop", raising(error))
            patch.setattr(attempts, "report", raising(error))
            report("layers", 0.5)
            assert not must_stop()
        separates(task)

    monkeypatch.setitem(context.settings.__dict__, "silence_seconds", silence)
    monkeypatch.setattr("service.workers.stopping.ASK_SECONDS", -1.0)
    monkeypatch.setattr(sandbox, "run", separate)
    if not goes_on:
        with pytest.raises(type(error)):
            run()
        return
    job = run()
    assert job is not None and job.state == State.SUCCEEDED
