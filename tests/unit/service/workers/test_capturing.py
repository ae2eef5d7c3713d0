"""Attempts that have a camera take the pair; the test is their process."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers import CameraNotFoundError
from service.api.context import Context
from service.errors import CrashError, NoProcessError, StorageFullError
from service.object_keys import captured_key
from service.problems import problem_of
from service.rows import attempts, cameras, heartbeats, jobs
from service.rows.states import State
from service.workers import capturing, host, sandbox
from service.workers.attempt import Attempt
from service.workers.stopping import Stopping
from service.workers.tasks import Task
from tests.unit.service.at_first import raising
from tests.unit.service.attempts import attempt_at

PAIR = {"no_flash": b"lamps", "flash": b"lamps and flash"}
TOLD = {"settings": {"iso": 400}, "info": None}


@pytest.fixture
def capture(context: Context) -> Callable[[], Attempt]:
    """Make an attempt that is to take the pair of a job; the test is its process."""
    row = {"id": "a", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with context.engine.begin() as connection:
        camera = cameras.add(connection, "sim://studio")
        jobs.add(connection, row | {"camera": camera, "capture": {"camera": "sim://studio"}})

    def make() -> Attempt:
        with context.engine.begin() as connection:
            held = cameras.claim(connection, "a", "w")
        return attempt_at(held, context)

    return make


def takes(task: Task, *_rest: object) -> dict[str, Any]:
    for frame, data in PAIR.items():
        (Path(task.directory) / frame).write_bytes(data)
    return TOLD


def _job(context: Context) -> jobs.Job:
    with context.engine.connect() as connection:
        job = jobs.find(connection, "a")
    assert job is not None
    return job


def test_a_pair_is_stored_and_the_job_passed_on_in_one(
    capture: Callable[[], Attempt], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sandbox, "run", takes)
    passed: list[jobs.Job | None] = []
    capture().capture(lambda connection: passed.append(jobs.find(connection, "a")))
    job = _job(context)
    assert passed == [job]
    assert (job.state, job.worker, job.stage) == (State.QUEUED, None, None)
    assert (job.camera_settings, job.stored_bytes) == ({"iso": 400}, 20)
    assert job.inputs is not None
    for frame, data in PAIR.items():
        assert context.storage.get(job.inputs[frame]["key"]) == data
        assert job.inputs[frame]["sha256"] == hashlib.sha256(data).hexdigest()


def test_a_pair_is_kept_for_good_before_the_card_is_cleared(
    capture: Callable[[], Attempt], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def take(task: Task, *rest: Any) -> None:
        takes(task)
        assert rest[-1]({"kind": "keep", "settings": {"iso": 400}}, lambda: False) is True
        job = _job(context)
        assert job.inputs and job.captures
        assert context.storage.get(job.inputs["flash"]["key"]) == PAIR["flash"]
        raise CrashError("It crashed.")  # which costs the pair nothing

    monkeypatch.setattr(sandbox, "run", take)
    capture().capture(lambda _connection: None)
    job = _job(context)
    assert (job.state, job.error, job.camera_settings) == (State.QUEUED, None, {"iso": 400})


def test_an_attempt_that_counts_no_more_keeps_no_pair(
    capture: Callable[[], Attempt], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def freeze(task: Task, *rest: Any) -> dict[str, Any]:
        monkeypatch.setattr(sandbox, "run", takes)
        with context.engine.begin() as connection:
            heartbeats.leave(connection, "w")
        capture().capture(lambda _connection: None)  # another takes a whole pair meanwhile
        told = takes(task)
        (Path(task.directory) / "flash").write_bytes(b"another flash")
        assert rest[-1]({"kind": "keep", "settings": {}}, lambda: False) is False
        return told

    monkeypatch.setattr(sandbox, "run", freeze)
    passed: list[str] = []
    capture().capture(lambda _connection: passed.append("frozen"))
    assert passed == []
    job = _job(context)
    assert job.attempt == 2 and job.inputs
    kept = sorted(job.inputs[frame]["key"] for frame in PAIR)
    assert context.storage.list("jobs/a/") == kept
    assert context.storage.get(job.inputs["flash"]["key"]) == PAIR["flash"]


def test_a_pair_that_was_taken_outlasts_all_that_comes_after(
    capture: Callable[[], Attempt], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(task: Task, *rest: Any) -> None:
        takes(task)
        assert rest[-1]({"kind": "keep", "settings": {}}, lambda: False) is True
        raise sandbox.StoppedError

    monkeypatch.setattr(sandbox, "run", stop)
    capture().capture(lambda _connection: None)
    pair = sorted(captured_key("a", 1, frame) for frame in PAIR)
    assert context.storage.list("jobs/a/") == pair
    for attempt, (error, state) in enumerate(
        [(sandbox.StoppedError(), State.QUEUED), (CrashError("It crashed."), State.FAILED)], 2
    ):
        with context.engine.begin() as connection:
            held = attempts.claim(connection, "a", "w")
        assert held is not None and held.attempt == attempt
        monkeypatch.setattr(sandbox, "run", raising(error))
        attempt_at(held, context).run()
        assert _job(context).state == state
        assert context.storage.list("jobs/a/") == pair


def _taken_again(*_arguments: object) -> None:
    pytest.fail("the pair was taken again")


def test_a_pair_is_taken_once(
    capture: Callable[[], Attempt], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    attempt = capture()
    with context.engine.begin() as connection:
        attempts.set_inputs(connection, attempt._job, {"flash": {}}, 1, {})
        heartbeats.leave(connection, "w")
    monkeypatch.setattr(sandbox, "run", _taken_again)
    capture().capture(lambda _connection: None)
    assert _job(context).state == State.QUEUED


def test_a_capture_that_no_process_has_begun_is_begun_again(
    capture: Callable[[], Attempt], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    refusals: list[Exception] = [NoProcessError(), NoProcessError()]

    def run(task: Task, *_rest: object) -> dict[str, Any]:
        if refusals:
            raise refusals.pop()
        return takes(task)

    monkeypatch.setattr(sandbox, "run", run)
    monkeypatch.setattr(Stopping, "pause", lambda _stopping, _seconds: None)
    capture().capture(lambda _connection: None)
    job = _job(context)
    assert (job.state, job.attempt, refusals) == (State.QUEUED, 1, [])
    assert job.inputs and context.storage.get(job.inputs["flash"]["key"]) == PAIR["flash"]


def test_a_capture_that_was_begun_is_not(
    capture: Callable[[], Attempt], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(*_arguments: object) -> None:
        monkeypatch.setattr(sandbox, "run", _taken_again)
        raise StorageFullError("The disk is full.")

    monkeypatch.setattr(sandbox, "run", run)
    capture().capture(lambda _connection: None)
    job = _job(context)
    assert job.state == State.FAILED and job.error
    assert job.error["type"] == "urn:lightlayers:problem:storage-full"


def test_a_request_waits_in_the_row(
    capture: Callable[[], Attempt], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    attempt = capture()

    def confirm(_seconds: float) -> None:
        job = _job(context)
        assert (job.state, job.request) == (State.WAITING_FOR_OPERATOR, "Switch it off.")
        with context.engine.begin() as connection:
            assert jobs.confirm(connection, "a")

    monkeypatch.setattr(attempt._means.stopping, "pause", confirm)
    assert capturing.ask_operator(attempt._means, "Switch it off.", 60, lambda: False) is True
    assert _job(context).state == State.RUNNING


def test_a_request_that_nobody_heeds_ends(capture: Callable[[], Attempt], context: Context) -> None:
    assert capturing.ask_operator(capture()._means, "Switch it off.", -1, lambda: False) is False
    assert _job(context).state == State.RUNNING


def test_a_request_ends_when_the_job_is_canceled(
    capture: Callable[[], Attempt], context: Context
) -> None:
    attempt = capture()
    with context.engine.begin() as connection:
        jobs.request_cancel(connection, "a")
    with pytest.raises(sandbox.StoppedError):
        capturing.ask_operator(attempt._means, "Switch it off.", 60, lambda: False)


def test_a_request_ends_with_the_process_that_made_it(capture: Callable[[], Attempt]) -> None:
    assert capturing.ask_operator(capture()._means, "Switch it off.", 60, lambda: True) is False


@pytest.mark.parametrize(
    ("address", "here", "told"),
    [
        ("ptp+usb://1", "studio", True),
        ("ptp+usb://1", None, False),  # there is no other host
        ("sim://studio", "studio", False),
    ],
)
def test_a_camera_on_usb_that_is_sought_on_the_wrong_host_is_told_with_what_to_do(
    address: str,
    here: str | None,
    told: bool,
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    row = {"id": "a", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with context.engine.begin() as connection:
        camera = cameras.add(connection, address)
        jobs.add(connection, row | {"camera": camera, "capture": {"camera": address}})
        held = cameras.claim(connection, "a", "w")

    def run(*_arguments: object) -> None:
        error = CameraNotFoundError("No camera is on USB.")
        raise sandbox.TaskError(problem_of(error, "").model_dump())

    monkeypatch.setattr(sandbox, "run", run)
    monkeypatch.setattr(host, "of_usb", lambda _engine: here)
    attempt_at(held, context).capture(lambda _connection: None)
    failed = _job(context)
    assert failed.state == State.FAILED and failed.error
    sentence, _, advice = failed.error["detail"].partition(
        " It was looked for on the worker's host"
    )
    assert sentence == "No camera is on USB."
    assert ("run `lightlayers serve` there, ask it for GET /cameras" in advice) is told


@pytest.mark.parametrize(
    ("error", "orders"),
    [
        (CrashError("It crashed."), ["relay {state}"]),
        (sandbox.StoppedError(), ["relay {state}"]),
        (sandbox.TaskError(problem_of(CameraNotFoundError("Away."), "").model_dump()), []),
    ],
)
def test_the_switch_of_a_flash_is_told_off_where_the_process_of_a_capture_could_not(
    error: Exception, orders: list[str], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = {"id": "a", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    asked = {"camera": "sim://studio", "flash": "external"}
    with context.engine.begin() as connection:
        camera = cameras.add(connection, "sim://studio")
        jobs.add(connection, row | {"camera": camera, "capture": asked})
        held = cameras.claim(connection, "a", "w")
    told: list[str] = []
    monkeypatch.setattr(sandbox, "run", raising(error))
    monkeypatch.setattr("drivers.leave_flash_off", told.append)
    settings = context.settings.model_copy(update={"flash_switch": "relay {state}"})
    attempt_at(held, context, settings).capture(lambda _connection: None)
    assert told == orders
