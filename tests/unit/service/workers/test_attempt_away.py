"""Attempts that database or store do not serve at their end; the test is their process."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError, PermissionDeniedError

from pipeline.result_names import MANIFEST
from service.api.context import Context
from service.object_keys import results_key
from service.rows import attempts, expiry, jobs, kept
from service.rows.states import State
from service.storage.base import Storage
from service.storage.folder import FolderStorage
from service.workers import sandbox
from service.workers.attempt import Attempt
from service.workers.means import Means
from service.workers.stopping import Stopping
from service.workers.tasks import RESULTS, Task
from tests.unit.service.asking import stored, stored_job
from tests.unit.service.at_first import raising
from tests.unit.service.attempts import attempt_at

TAKEN_WITH = {"make": "NIKON", "model": "D5100", "body": "", "rendered": False}


def _attempt(context: Context, job_id: str) -> Attempt:
    with context.engine.begin() as connection:
        held = attempts.claim(connection, job_id, "w")
    return attempt_at(held, context)


def test_a_database_that_is_away_when_the_camera_is_noted_costs_no_second_calibration(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    away = [sa.exc.OperationalError("", None, sqlite3.OperationalError("away"))]
    set_inputs = attempts.set_inputs

    def calibrate(task: Task, *_rest: object) -> None:
        made.append(task.kind)
        folder = Path(task.directory) / RESULTS
        folder.mkdir()
        (folder / MANIFEST).write_text(json.dumps({"taken_with": TAKEN_WITH}))

    def set_in_the_end(*arguments: Any) -> bool:
        if away:
            raise away.pop()
        return set_inputs(*arguments)

    monkeypatch.setattr(sandbox, "run", calibrate)
    monkeypatch.setattr(attempts, "set_inputs", set_in_the_end)
    monkeypatch.setattr(Stopping, "pause", lambda _stopping, _seconds: None)
    options = {"kind": "flash", "card": {"x": 20, "y": 20, "radius": 5}}
    job_id = stored_job(context, options=options)
    _attempt(context, job_id).run()
    job = stored(context.engine, job_id)
    assert (job.state, job.attempt, made) == (State.SUCCEEDED, 1, ["calibrate"])
    assert kept.taken_with(job).model == "D5100"


@pytest.mark.parametrize("end", ["canceled", "deleted"])
def test_files_that_cannot_be_deleted_hold_no_worker_up(
    end: str, context: Context, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A bucket may let the service write and read alone."""
    job_id = stored_job(context)
    attempt = _attempt(context, job_id)
    context.storage.put(results_key(job_id, 1, "a.png"), b"half")
    with context.engine.begin() as connection:
        jobs.request_cancel(connection, job_id)
        if end == "deleted":
            expiry.remove(connection, job_id)

    def refuse(_storage: Storage, _prefix: str) -> None:
        raise PermissionDeniedError("no right to delete")

    monkeypatch.setattr(FolderStorage, "delete_below", refuse)
    attempt.outcome.give_up()
    assert "files of an attempt that does not count cannot be deleted" in caplog.text
    if end == "canceled":
        assert stored(context.engine, job_id).state == State.CANCELED


def test_an_attempt_leaves_nothing_beside_the_one_that_took_it_over_and_succeeded(
    context: Context,
) -> None:
    job_id = stored_job(context)
    frozen = _attempt(context, job_id)
    with context.engine.begin() as connection:
        other = attempts.claim(connection, job_id, "another worker")
        assert other is not None and attempts.succeed(connection, other, [])
    context.storage.put(results_key(job_id, 1, "a.png"), b"half")
    context.storage.put(results_key(job_id, 2, "a.png"), b"whole")
    assert not frozen.outcome.fail({"detail": "too late"})
    frozen.outcome.give_up()
    left = [context.storage.list(results_key(job_id, attempt)) for attempt in (1, 2)]
    assert left == [[], [results_key(job_id, 2, "a.png")]]
    assert stored(context.engine, job_id).state == State.SUCCEEDED


def test_files_of_an_attempt_are_deleted_once_the_store_is_back(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    job_id = stored_job(context)
    attempt = _attempt(context, job_id)
    context.storage.put(results_key(job_id, 1, "a.png"), b"half")
    away = raising(GenericError("away"))
    with monkeypatch.context() as patch:
        patch.setattr(FolderStorage, "delete_below", away)
        patch.setattr(Storage, "check", away)
        with pytest.raises(GenericError):
            attempt.outcome.give_up()
    attempt.outcome.give_up()
    assert context.storage.list(results_key(job_id, 1)) == []


def test_a_worker_that_ends_while_a_result_goes_to_the_store_costs_the_job_nothing(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over a slow line it goes for minutes, and a worker that waited for that would be killed."""
    ends: list[bool] = []
    stored_files: list[str] = []

    def separate(task: Task, *_rest: object) -> None:
        folder = Path(task.directory) / RESULTS
        folder.mkdir()
        (folder / "layers.exr").write_bytes(b"light")

    def put(_storage: Storage, _key: str, path: Path, _headers: object, check: Any) -> str:
        check()
        ends.append(True)
        check()
        stored_files.append(path.name)
        return ""

    monkeypatch.setattr(sandbox, "run", separate)
    monkeypatch.setattr(Storage, "put_file", put)
    job_id = stored_job(context)
    with context.engine.begin() as connection:
        held = attempts.claim(connection, job_id, "w")
    assert held is not None
    parts = (context.engine, context.storage, context.settings)
    Attempt(Means.of(held, *parts, lambda: bool(ends)), context.fork_server).run()
    job = stored(context.engine, job_id)
    assert (job.state, job.attempt, job.lost, stored_files) == (State.QUEUED, 1, 0, [])
