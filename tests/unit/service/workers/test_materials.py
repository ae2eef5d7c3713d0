"""What an attempt lays before its process."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import sqlalchemy as sa

from service.api.context import Context
from service.errors import CrashError
from service.rows import jobs, kept
from service.workers import kept_file, sandbox
from service.workers.tasks import Task
from tests.unit.service.attempts import attempt_once


def test_a_calibration_that_is_deleted_at_this_moment_is_left_out(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(_connection: sa.Connection, job: jobs.Job) -> list[jobs.Job]:
        return [replace(job, id="gone", options={"kind": "flash", "setup": "desk"})]

    brought: list[object] = []

    def work(task: Task, *_rest: object) -> None:
        brought.append(kept_file.read(Path(task.directory)))
        raise CrashError("It crashed.")

    monkeypatch.setattr(kept, "for_separation", gone)
    monkeypatch.setattr(sandbox, "run", work)
    job = attempt_once(context)
    assert brought == [[]]
    assert job is not None and job.error is not None
    assert job.error["detail"] == "It crashed."
