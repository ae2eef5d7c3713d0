from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from obstore.exceptions import GenericError

from service.api.context import Context
from service.api.idempotency import digest
from service.errors import StorageFullError
from service.rows import expiry, jobs
from service.settings import Settings
from service.storage.base import Storage
from service.storage.folder import FolderStorage
from tests.unit.service.asking import (
    ended_while_waiting,
    post_capture,
    post_pair,
    problem_of,
    rows_of,
    stored_job,
)

Png = Callable[..., bytes]
Job = dict[str, Any]

SIM = "sim://studio"


@pytest.fixture
def job(http: httpx.Client, context: Context) -> Job:
    """A job on a pair, with options."""
    job_id = stored_job(context, options={"lights": 2}, priority="low")
    made: Job = http.get(f"/jobs/{job_id}").json()
    return made


def _rerun(http: httpx.Client, job: Job, body: Any = None, **headers: str) -> httpx.Response:
    if body is None:
        return http.post(f"/jobs/{job['id']}/rerun", headers=headers)
    return http.post(f"/jobs/{job['id']}/rerun", json=body, headers=headers)


def test_a_rerun_is_a_job_of_its_own_on_the_same_photographs(
    http: httpx.Client, job: Job, context: Context
) -> None:
    body = {"options": {"lights": 1}, "priority": "high", "deadline_seconds": 60}
    answer = _rerun(http, job, body)
    assert answer.status_code == 202
    made = answer.json()
    assert answer.headers["location"] == f"/jobs/{made['id']}" != job["links"]["self"]
    assert (made["state"], made["options"], made["priority"]) == ("queued", {"lights": 1}, "high")
    assert made["deadline"] is not None
    assert made["inputs"] == job["inputs"]
    for frame in ("no_flash", "flash"):
        first, second = (
            context.storage.get(f"jobs/{one['id']}/inputs/{frame}") for one in (job, made)
        )
        assert first == second


def test_a_rerun_may_be_waited_for(
    http: httpx.Client, job: Job, finish: Callable[[str, dict[str, bytes]], None]
) -> None:
    made, answer = ended_while_waiting(http, finish, lambda: _rerun(http, job, prefer="wait=60"))

    assert (answer.status_code, answer.json()["id"]) == (202, made)
    assert answer.json()["state"] == "succeeded"
    assert answer.headers["preference-applied"] == "wait=60"


@pytest.mark.parametrize("body", [None, {}, {"options": None}])
def test_without_options_they_are_those_of_the_job(body: Any, http: httpx.Client, job: Job) -> None:
    made = _rerun(http, job, body).json()
    assert (made["options"], made["priority"], made["deadline"]) == ({"lights": 2}, "normal", None)


def test_a_rerun_may_exchange_the_photographs(
    http: httpx.Client, job: Job, context: Context
) -> None:
    made = _rerun(http, job, {"swapped": True}).json()
    assert made["inputs"]["no_flash"] == job["inputs"]["flash"]
    assert made["inputs"]["flash"] == job["inputs"]["no_flash"]
    assert made["inputs"]["flash"] != made["inputs"]["no_flash"]
    assert made["options"] == job["options"]
    for frame, of in (("no_flash", "flash"), ("flash", "no_flash")):
        copy, source = (
            context.storage.get(f"jobs/{name}")
            for name in (f"{made['id']}/inputs/{frame}", f"{job['id']}/inputs/{of}")
        )
        assert copy == source
    back = _rerun(http, made, {"swapped": True}).json()
    assert back["inputs"] == job["inputs"]


@pytest.mark.parametrize("deleted", ["the first", "the rerun"])
def test_deleting_one_leaves_the_other(
    deleted: str, http: httpx.Client, job: Job, context: Context
) -> None:
    made = _rerun(http, job).json()
    one, other = (job, made) if deleted == "the first" else (made, job)
    assert http.delete(one["links"]["self"]).status_code == 204
    assert len(context.storage.list(f"jobs/{other['id']}/inputs/")) == 2
    assert len(context.storage.list("")) == 2


def test_copies_are_on_the_disk_before_their_job_is(
    http: httpx.Client, job: Job, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows: dict[str, int] = {}

    def note(descriptor: int) -> None:
        rows[Path(f"/proc/self/fd/{descriptor}").readlink().name] = len(rows_of(context))

    monkeypatch.setattr(os, "fsync", note)
    made = _rerun(http, job).json()
    assert rows == dict.fromkeys(["flash", "no_flash", "inputs", made["id"], "jobs", "store"], 1)


def test_copies_that_cannot_be_stored_make_no_job(
    http: httpx.Client, job: Job, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_storage: Storage, _keys: object) -> None:
        raise GenericError("full")

    monkeypatch.setattr(FolderStorage, "flush", fail)
    assert problem_of(_rerun(http, job))[:2] == (503, "store-unavailable")
    assert [row.id for row in rows_of(context)] == [job["id"]]
    assert len(context.storage.list("")) == 2


def test_a_disk_that_fills_up_between_two_copies_keeps_neither(
    http: httpx.Client, job: Job, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = Storage.copy

    def fill_up(storage: Storage, key: str, other: str) -> None:
        if len(storage.list("")) > 2:
            raise StorageFullError("The disk is full.")
        copy(storage, key, other)

    monkeypatch.setattr(Storage, "copy", fill_up)
    assert problem_of(_rerun(http, job))[:2] == (507, "storage-full")
    assert [row.id for row in rows_of(context)] == [job["id"]]
    assert len(context.storage.list("")) == 2


@pytest.mark.parametrize("end", ["failed", "canceled"])
def test_a_job_without_results_can_be_run_again(
    end: str, http: httpx.Client, job: Job, context: Context
) -> None:
    with context.engine.begin() as connection:
        if end == "canceled":
            jobs.request_cancel(connection, job["id"])
        else:
            assert jobs.fail_waiting(connection, job["id"], {})
    assert _rerun(http, job).status_code == 202


def test_a_calibration_is_run_again_as_one(http: httpx.Client, context: Context) -> None:
    options = {"kind": "flash", "card": {"x": 20, "y": 20, "radius": 5}}
    job = {"id": stored_job(context, options=options)}
    assert _rerun(http, job).json()["options"] == options
    other = {"kind": "lamps", "sphere": {"x": 20, "y": 20, "radius": 5}}
    assert _rerun(http, job, {"options": other}).json()["options"] == other
    assert problem_of(_rerun(http, job, {"options": {"lights": 2}}))[:2] == (422, "invalid-option")


def test_a_captured_pair_is_run_again_with_what_its_camera_was_set_to(
    http: httpx.Client, context: Context
) -> None:
    settings, capture = {"iso": 400, "f_number": 8.0}, {"camera": SIM}
    job = {"id": stored_job(context, capture=capture, camera_settings=settings)}
    made = _rerun(http, job).json()
    assert made["camera_settings"] == settings
    first, second = (http.get(f"/jobs/{each['id']}").json()["capture"] for each in (job, made))
    assert first == second
    (camera,) = (each["id"] for each in http.get("/cameras").json() if each["address"] == SIM)
    shot = http.post(f"/cameras/{camera}/captures", json={"like": made["id"]})
    assert shot.json()["jobs"][0]["capture"]["settings"] == settings


class TestIdempotencyKey:
    def test_gives_the_same_job_again(self, http: httpx.Client, job: Job, context: Context) -> None:
        first = _rerun(http, job, {"options": {}}, **{"idempotency-key": "once"})
        again = _rerun(http, job, {"options": {}}, **{"idempotency-key": "once"})
        assert again.json() == first.json()
        assert again.headers["idempotency-replayed"] == "true"
        assert len(rows_of(context)) == 2
        assert len(context.storage.list("")) == 4

    def test_is_of_what_was_asked_for_alone(
        self, http: httpx.Client, job: Job, context: Context
    ) -> None:
        made = _rerun(http, job, {"options": {"lights": 2}, "priority": "normal"}).json()
        (row,) = (row for row in rows_of(context) if row.id == made["id"])
        wanted = {"options": {"lights": 2}, "priority": "normal"}
        asked = {"rerun": job["id"], "wanted": wanted}
        assert row.request_hash == digest(asked)

    def test_does_so_when_the_first_run_is_deleted(self, http: httpx.Client, job: Job) -> None:
        first = _rerun(http, job, **{"idempotency-key": "once"}).json()
        http.delete(job["links"]["self"])
        again = _rerun(http, job, **{"idempotency-key": "once"})
        assert (again.status_code, again.json()["id"]) == (202, first["id"])

    @pytest.mark.parametrize(
        "body", [{"options": {"lights": 3}}, {"priority": "high"}, {"swapped": True}]
    )
    def test_is_for_one_request(self, body: Any, http: httpx.Client, job: Job) -> None:
        _rerun(http, job, **{"idempotency-key": "once"})
        other = _rerun(http, job, body, **{"idempotency-key": "once"})
        assert problem_of(other)[:2] == (422, "idempotency-key-reused")

    def test_of_an_upload_is_none_of_a_rerun(self, http: httpx.Client, png: Png) -> None:
        headers = {"idempotency-key": "once"}
        job = post_pair(http, png(64, 48), png(64, 48, True), headers=headers).json()
        assert problem_of(_rerun(http, job, **headers))[:2] == (422, "idempotency-key-reused")


def test_a_job_without_photographs_yet_cannot_be_run_again(http: httpx.Client) -> None:
    job = post_capture(http)
    assert problem_of(_rerun(http, job)) == (
        409,
        "not-ready",
        "The job has no photographs yet; its camera has not taken them.",
    )
    http.post(job["links"]["cancel"])
    assert problem_of(_rerun(http, job))[:2] == (409, "ended")


def test_a_job_that_is_being_removed_is_gone(
    http: httpx.Client, job: Job, context: Context
) -> None:
    with context.engine.begin() as connection:
        jobs.request_cancel(connection, job["id"])
        expiry.condemn(connection, job["id"])
    assert http.get(job["links"]["self"]).json()["state"] == "expired"
    assert problem_of(_rerun(http, job))[:2] == (410, "gone")


def test_photographs_that_go_at_this_moment_make_no_job(
    http: httpx.Client, job: Job, context: Context
) -> None:
    (context.settings.data_dir / "store" / "jobs" / job["id"] / "inputs" / "flash").unlink()
    assert problem_of(_rerun(http, job))[:2] == (410, "gone")
    assert [row.id for row in rows_of(context)] == [job["id"]]
    assert len(context.storage.list("")) == 1


def test_a_job_that_is_not_there_cannot_be_run_again(http: httpx.Client) -> None:
    assert problem_of(http.post("/jobs/nothing/rerun"))[:2] == (404, "unknown-job")


@pytest.mark.parametrize(
    ("sent", "status", "kind"),
    [
        ({"json": {"options": {"lights": 9}}}, 422, "invalid-option"),
        ({"json": {"options": []}}, 422, "invalid-option"),
        ({"json": {"speed": 1}}, 422, "invalid-option"),
        ({"json": {"swapped": "yes"}}, 422, "invalid-option"),
        ({"json": {"deadline_seconds": -1}}, 422, "invalid-option"),
        ({"json": {"options": {"camera": {"calibration": "nothing"}}}}, 422, "invalid-option"),
        ({"content": b"{", "headers": {"content-type": "application/json"}}, 422, "invalid-option"),
        ({"content": b"options"}, 415, "unsupported-media-type"),
        ({"json": {"options": {"camera": "x" * 1_100_000}}}, 413, "upload-too-large"),
    ],
)
def test_what_cannot_be_done_is_told(
    sent: dict[str, Any], status: int, kind: str, http: httpx.Client, job: Job, context: Context
) -> None:
    answer = http.post(f"/jobs/{job['id']}/rerun", **sent)
    assert problem_of(answer)[:2] == (status, kind)
    assert len(rows_of(context)) == 1
    assert len(context.storage.list("")) == 2


class TestFullQueue:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"queued_jobs_per_key": 1})

    def test_refuses_reruns(self, http: httpx.Client, job: Job, context: Context) -> None:
        status, kind, detail = problem_of(_rerun(http, job))
        assert (status, kind) == (429, "queue-full")
        assert detail == "1 job of yours waits already; send this one again later."
        assert len(context.storage.list("")) == 2


def test_a_mix_cannot_be_run_again(http: httpx.Client, context: Context) -> None:
    """Neither now nor later: it is no question of time."""
    options = {"kind": "mix", "of": "a", "mix": {"lamps": [{"ev": 1}]}}
    answer = _rerun(http, {"id": stored_job(context, options=options, inputs=None)})
    assert problem_of(answer) == (
        422,
        "invalid-option",
        "The job is a mix, which has no photographs of its own; mix the layers again, or run the "
        "job again that they are of.",
    )
    assert answer.json()["retryable"] is False
