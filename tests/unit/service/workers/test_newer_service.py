"""A job whose options a newer service took waits for a worker that knows them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import sqlalchemy as sa

from service.errors import OlderWorkerError
from service.frames import FRAMES
from service.object_keys import inputs_key
from service.problems import problem_of
from service.rows import jobs
from service.rows.states import State
from service.settings import Settings
from service.workers import sandbox
from service.workers.worker import Worker
from tests.unit.service.job_rows import added_pair


@pytest.fixture
def older(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Iterator[Worker]:
    """A worker that has a job "a", and whose processes do not know an option of it."""
    problem = problem_of(OlderWorkerError("of_tomorrow: this name is not known."), "1" * 32)

    def refuse(*_arguments: object) -> None:
        raise sandbox.TaskError(problem.model_dump())

    monkeypatch.setattr(sandbox, "run", refuse)
    older = Worker(settings.model_copy(update={"patience_seconds": 25.0}))
    older.upkeep._beat()
    for frame in FRAMES:
        older._storage.put(inputs_key("a", frame), frame.encode())
    added_pair(older._engine, options={"of_tomorrow": 1})
    yield older
    older._engine.dispose()


def _find(older: Worker) -> jobs.Job:
    with older._engine.connect() as connection:
        job = jobs.find(connection, "a")
    assert job is not None
    return job


def _waiting(older: Worker) -> list[tuple[str, str]]:
    """Id and state of what the queue of jobs has."""
    found = older._queue._client.list_workflows(queues_only=True)
    return [(one.workflow_id, one.status) for one in found]


def test_it_is_put_back_and_comes_out_of_the_queue_later(older: Worker) -> None:
    older.run("a")
    job = _find(older)
    assert (job.state, job.attempt, job.lost, job.worker) == (State.QUEUED, 1, 0, None)
    assert _waiting(older) == [("a-again-1", "DELAYED")]
    older.run("a", 1)
    assert (_find(older).state, _find(older).attempt) == (State.QUEUED, 2)
    assert sorted(_waiting(older)) == [("a-again-1", "DELAYED"), ("a-again-2", "DELAYED")]


def test_when_none_came_for_long_it_fails_and_says_that_the_workers_are_older(
    older: Worker,
) -> None:
    older.run("a", 3)
    job = _find(older)
    assert (job.state, _waiting(older)) == (State.FAILED, [])
    assert job.error is not None
    assert (job.error["type"], job.error["retryable"]) == (
        "urn:lightlayers:problem:older-worker",
        True,
    )
    assert job.error["detail"] == (
        "of_tomorrow: this name is not known; the workers are older than the service that took "
        "the job: have its operator upgrade them, then run the job again."
    )


def test_one_that_is_canceled_meanwhile_is_not_put_back(
    older: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse = sandbox.run

    def cancel(*arguments: Any) -> None:
        with older._engine.begin() as connection:
            jobs.request_cancel(connection, "a")
        refuse(*arguments)

    monkeypatch.setattr(sandbox, "run", cancel)
    older.run("a")
    assert (_find(older).state, _waiting(older)) == (State.CANCELED, [])


def test_where_the_queue_takes_nothing_the_job_stays_with_the_worker(
    older: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.workers.worker._RETRY_SECONDS", 0.0)
    submit = older._queue.submit
    states: list[State] = []

    def fail(*arguments: Any, **more: Any) -> None:
        if not states:
            states.append(_find(older).state)
            raise sa.exc.DataError("", None, Exception("broken"))
        submit(*arguments, **more)

    monkeypatch.setattr(older._queue, "submit", fail)
    older.run("a")
    assert (states, _find(older).state) == ([State.RUNNING], State.QUEUED)
    assert _waiting(older) == [("a-again-1", "DELAYED")]
