from __future__ import annotations

import errno
import os
import socket
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from pipeline.options import Options
from service import jobs, sandbox
from service.api.accept import hash_of
from service.api.context import Context
from service.api.intake import Intake
from service.api.models import Handling
from service.capture import Capture
from service.errors import (
    AttemptError,
    CrashError,
    FileLimitError,
    KilledError,
    MemoryLimitError,
    OutputLimitError,
    TimeLimitError,
)
from service.settings import Settings
from service.storage import Storage
from tests.unit.service.asking import post_capture, post_pair, problem_of, rows_of

Png = Callable[..., bytes]
Checked = Callable[[Exception], httpx.Response]


def test_photographs_are_on_the_disk_before_their_job_is(
    http: httpx.Client, png: Png, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows: dict[str, int] = {}

    def note(descriptor: int) -> None:
        name = Path(f"/proc/self/fd/{descriptor}").readlink().name
        rows[name] = len(rows_of(context))

    monkeypatch.setattr(os, "fsync", note)
    job = post_pair(http, png(64, 48), png(64, 48, True)).json()
    assert rows == dict.fromkeys(["flash", "no_flash", "inputs", job["id"], "jobs", "store"], 0)
    assert [row.id for row in rows_of(context)] == [job["id"]]


def test_photographs_that_the_disk_does_not_keep_make_no_job(
    http: httpx.Client, png: Png, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_descriptor: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", fail)
    answer = post_pair(http, png(64, 48), png(64, 48, True))
    assert problem_of(answer)[:2] == (503, "store-unavailable")
    assert rows_of(context) == []
    assert context.storage.list("") == []


@pytest.fixture
def checked(http: httpx.Client, png: Png, monkeypatch: pytest.MonkeyPatch) -> Checked:
    """Send a pair whose check of headers ends so; what follows is checked as ever."""

    def send(end: Exception) -> httpx.Response:
        with monkeypatch.context() as ended:
            ended.setattr(sandbox, "run", _raising(end))
            return post_pair(http, png(64, 48), png(64, 48, True))

    return send


@pytest.mark.parametrize(
    ("death", "said"),
    [
        (CrashError(""), "crashed on these"),
        (MemoryLimitError(""), "want more memory"),
        (FileLimitError(""), "more open files"),
        (OutputLimitError(""), "larger than what a job may write"),
    ],
)
def test_what_kills_the_check_of_headers_is_no_photograph(
    death: AttemptError, said: str, checked: Checked, context: Context
) -> None:
    status, kind, detail = problem_of(checked(death))
    assert (status, kind) == (422, "unreadable-image")
    assert said in detail
    assert context.storage.list("") == []


@pytest.mark.parametrize(
    ("death", "said"),
    [(TimeLimitError(""), "not read within 30 s"), (KilledError(""), "The system killed")],
)
def test_a_check_that_an_overloaded_machine_ends_is_asked_for_again(
    death: AttemptError,
    said: str,
    checked: Checked,
    context: Context,
    http: httpx.Client,
    png: Png,
) -> None:
    answer = checked(death)
    status, kind, detail = problem_of(answer)
    assert (status, kind, answer.json()["retryable"]) == (503, "service-not-ready", True)
    assert said in detail and "overloaded, or they are damaged" in detail
    assert context.storage.list("") == []
    assert post_pair(http, png(64, 48), png(64, 48, True)).status_code == 202


def test_a_check_that_somebody_ends_is_asked_for_again(checked: Checked) -> None:
    answer = checked(ChildProcessError())
    assert problem_of(answer)[:2] == (503, "service-not-ready")
    assert answer.json()["retryable"]


def test_a_disk_that_fills_up_during_an_upload_is_told(
    http: httpx.Client, png: Png, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr(tempfile, "mkdtemp", _raising(full))
    for answer in (
        post_pair(http, png(64, 48), png(64, 48, True)),
        http.post("/jobs", json={"capture": {"camera": "sim://studio"}}),
    ):
        status, kind, detail = problem_of(answer)
        assert (status, kind) == (507, "storage-full")
        assert "is full" in detail and answer.json()["retryable"]


def _raising(error: Exception) -> Callable[..., None]:
    def fail(*_arguments: object, **_named: object) -> None:
        raise error

    return fail


class TestFullQueue:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"queued_jobs": 2})

    def test_more_jobs_than_may_wait_are_refused(self, http: httpx.Client) -> None:
        first = post_capture(http)
        post_capture(http)
        answer = http.post("/jobs", json={"capture": {"camera": "sim://studio"}})
        assert problem_of(answer)[:2] == (429, "queue-full")
        assert answer.json()["retryable"]
        assert int(answer.headers["retry-after"]) > 0
        http.post(first["links"]["cancel"])
        post_capture(http)

    def test_a_full_queue_still_gives_the_job_of_a_key(self, http: httpx.Client) -> None:
        first = post_capture(http, **{"idempotency-key": "once"})
        post_capture(http)
        assert post_capture(http, **{"idempotency-key": "once"})["id"] == first["id"]
        wanted = {"capture": {"camera": "sim://studio"}}
        answer = http.post("/jobs", json=wanted, headers={"idempotency-key": "new"})
        assert problem_of(answer)[:2] == (429, "queue-full")

    def test_a_queue_that_fills_during_an_upload_refuses_it(
        self, http: httpx.Client, png: Png, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        counts = iter([1, 1, 2, 2])  # of the caller and in all, twice
        monkeypatch.setattr(jobs, "count_queued", lambda _connection, _owner=None: next(counts))
        answer = post_pair(http, png(64, 48), png(64, 48, True))
        assert problem_of(answer)[:2] == (429, "queue-full")
        assert context.storage.list("") == []

    @pytest.mark.parametrize("path", ["/jobs", "/calibrations"])
    def test_a_full_queue_is_told_before_the_body_is_read(
        self, path: str, http: httpx.Client
    ) -> None:
        post_capture(http)
        post_capture(http)
        assert _answer_to_a_head(http, path).startswith("HTTP/1.1 429 ")


class TestLowDisk:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"free_bytes": 2**62})

    def test_new_jobs_are_refused(
        self, http: httpx.Client, png: Png, context: Context, caplog: pytest.LogCaptureFixture
    ) -> None:
        capture = http.post("/jobs", json={"capture": {"camera": "sim://studio"}})
        for answer in (post_pair(http, png(64, 48), png(64, 48, True)), capture):
            status, kind, detail = problem_of(answer)
            assert (status, kind) == (507, "storage-full")
            assert "delete jobs" in detail
            assert answer.json()["retryable"]
        told = [(record.getMessage(), record.exc_info) for record in caplog.records]
        assert told == [("no room for a job", None)] * 2
        assert rows_of(context) == []
        assert context.storage.list("") == []

    @pytest.mark.parametrize("path", ["/jobs", "/calibrations"])
    def test_that_is_told_before_the_body_is_read(self, path: str, http: httpx.Client) -> None:
        assert _answer_to_a_head(http, path).startswith("HTTP/1.1 507 ")

    def test_a_store_that_is_no_folder_has_no_disk_to_fill(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(Storage, "free_bytes", lambda _storage: None)
        assert post_capture(http)["state"] == "queued"

    def test_the_job_of_a_key_is_still_given(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with monkeypatch.context() as roomy:
            roomy.setattr(Storage, "free_bytes", lambda _storage: 2**62)
            first = post_capture(http, **{"idempotency-key": "once"})
        assert post_capture(http, **{"idempotency-key": "once"})["id"] == first["id"]


def _answer_to_a_head(http: httpx.Client, path: str) -> str:
    """Send the head of a large upload and wait for the answer before sending more."""
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 90000\r\n"
    head += "Content-Type: multipart/form-data; boundary=edge\r\n\r\n"
    with socket.create_connection((http.base_url.host, http.base_url.port or 80), 60) as client:
        client.sendall(head.encode())
        return client.recv(1000).decode()


def test_an_idempotency_key_gives_the_same_job_again(
    http: httpx.Client, png: Png, context: Context
) -> None:
    headers = {"idempotency-key": "once"}
    first = post_pair(http, png(64, 48), png(64, 48, True), headers=headers)
    again = post_pair(http, png(64, 48), png(64, 48, True), headers=headers)
    assert (again.status_code, again.json()["id"]) == (202, first.json()["id"])
    assert again.json() == first.json()
    assert again.headers["location"] == first.headers["location"]
    assert again.headers["idempotency-replayed"] == "true"
    assert "idempotency-replayed" not in first.headers
    assert len(http.get("/jobs").json()["jobs"]) == 1
    assert len(context.storage.list("")) == 2


def test_requests_with_one_key_that_come_at_once_make_one_job(
    http: httpx.Client, png: Png, context: Context
) -> None:
    def send(_number: int) -> httpx.Response:
        headers = {"idempotency-key": "once"}
        return post_pair(http, png(64, 48), png(64, 48, True), headers=headers)

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(send, range(4)))
    assert [answer.status_code for answer in answers] == [202] * 4
    assert len({answer.headers["location"] for answer in answers}) == 1
    replayed = [answer.headers.get("idempotency-replayed", "no") for answer in answers]
    assert sorted(replayed) == ["no", "true", "true", "true"]
    assert [job.id for job in rows_of(context)] == [answers[0].json()["id"]]
    assert len(context.storage.list("")) == 2


def test_a_key_whose_upload_broke_off_is_as_new(
    http: httpx.Client, png: Png, context: Context
) -> None:
    head = "POST /jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 90000\r\n"
    head += "Idempotency-Key: once\r\nContent-Type: multipart/form-data; boundary=edge\r\n\r\n"
    with socket.create_connection((http.base_url.host, http.base_url.port or 80)) as client:
        client.sendall(f"{head}--edge\r\n".encode())
    headers = {"idempotency-key": "once"}
    assert problem_of(post_pair(http, b"no picture", png(64, 48), headers=headers))[0] == 422
    answer = post_pair(http, png(64, 48), png(64, 48, True), headers=headers)
    assert (answer.status_code, "idempotency-replayed" in answer.headers) == (202, False)
    assert [job.id for job in rows_of(context)] == [answer.json()["id"]]


def test_the_key_of_a_deleted_job_is_as_new(http: httpx.Client) -> None:
    first = post_capture(http, **{"idempotency-key": "once"})
    http.delete(first["links"]["self"])
    second = post_capture(http, **{"idempotency-key": "once"})
    assert second["id"] != first["id"]


def test_a_job_that_is_deleted_while_its_key_is_sent_again_asks_for_another_try(
    http: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    post_capture(http, **{"idempotency-key": "once"})
    monkeypatch.setattr(jobs, "find_by_key", lambda _connection, _owner, _key: None)
    wanted = {"capture": {"camera": "sim://studio"}}
    answer = http.post("/jobs", json=wanted, headers={"idempotency-key": "once"})
    assert (answer.status_code, answer.json()["retryable"]) == (503, True)


class _LaterOptions(Options):
    tuned: bool = False


class _LaterHandling(Handling):
    tuned: bool = False


class _LaterCapture(Capture):
    tuned: bool = False


def test_what_a_later_release_adds_leaves_an_earlier_request_the_same() -> None:
    camera = "sim://studio"
    wanted = Intake(Options(lights=2), Handling(), Path(), capture=Capture(camera=camera))
    later = Intake(
        _LaterOptions(lights=2), _LaterHandling(), Path(), capture=_LaterCapture(camera=camera)
    )
    assert hash_of(later) == hash_of(wanted)
    for change in (
        {"options": _LaterOptions(lights=2, tuned=True)},
        {"handling": _LaterHandling(tuned=True)},
        {"capture": _LaterCapture(camera=camera, tuned=True)},
    ):
        assert hash_of(replace(later, **change)) != hash_of(wanted)


def _other_request(change: str, png: Png) -> dict[str, Any]:
    files = {"no_flash": ("a", png(64, 48)), "flash": ("b", png(64, 48, True))}
    others: dict[str, dict[str, Any]] = {
        "options": {"files": files, "data": {"options": '{"lights": 1}'}},
        "one photograph": {"files": {**files, "flash": ("b", png(64, 48, True) + b"\0")}},
        "both photographs": {"files": {"no_flash": files["flash"], "flash": files["no_flash"]}},
        "capture": {"json": {"capture": {"camera": "sim://studio"}}},
    }
    return others[change]


@pytest.mark.parametrize("change", ["options", "one photograph", "both photographs", "capture"])
def test_an_idempotency_key_is_for_one_request(
    change: str, http: httpx.Client, png: Png, context: Context
) -> None:
    headers = {"idempotency-key": "once"}
    first = post_pair(http, png(64, 48), png(64, 48, True), headers=headers)
    other = http.post("/jobs", headers=headers, **_other_request(change, png))
    assert problem_of(other)[:2] == (422, "idempotency-key-reused")
    assert [job["id"] for job in http.get("/jobs").json()["jobs"]] == [first.json()["id"]]
    assert len(context.storage.list("")) == 2


def test_another_cameras_capture_is_another_request(http: httpx.Client) -> None:
    headers = {"idempotency-key": "once"}
    post_capture(http, **headers)
    wanted = {"capture": {"camera": "sim://studio?lights=3"}}
    other = http.post("/jobs", json=wanted, headers=headers)
    assert problem_of(other)[:2] == (422, "idempotency-key-reused")


@pytest.mark.parametrize("key", [b"", b"x" * 256, b"two words", b"a\tb", "Schlüssel".encode()])
def test_an_idempotency_key_that_cannot_be_is_refused(key: bytes, http: httpx.Client) -> None:
    wanted = {"capture": {"camera": "sim://studio"}}
    answer = http.post("/jobs", json=wanted, headers=[(b"idempotency-key", key)])
    status, kind, detail = problem_of(answer)
    assert (status, kind) == (422, "invalid-request")
    assert detail.startswith("header.idempotency-key: use 1 to 255 visible ASCII characters")
    assert http.get("/jobs").json()["jobs"] == []


@pytest.mark.parametrize("key", ["x" * 255, '"8e03978e-40d5-43dd-bc93-6894a57f9324"', "!~"])
def test_an_idempotency_key_may_be_any_visible_text(key: str, http: httpx.Client) -> None:
    made = [post_capture(http, **{"idempotency-key": key})["id"] for _ in range(2)]
    assert made[0] == made[1]


class TestHandling:
    def test_is_normal_where_nothing_is_asked(self, http: httpx.Client) -> None:
        job = post_capture(http)
        assert (job["priority"], job["deadline"], job["expires"]) == ("normal", None, None)

    def test_comes_with_a_capture(self, http: httpx.Client) -> None:
        body = {"capture": {"camera": "sim://studio"}, "priority": "low"}
        assert http.post("/jobs", json=body).json()["priority"] == "low"

    def test_comes_with_a_pair(self, http: httpx.Client, png: Png) -> None:
        answer = post_pair(
            http, png(64, 48), png(64, 48, True), data={"handling": '{"priority": "high"}'}
        )
        assert answer.json()["priority"] == "high"

    @pytest.mark.parametrize(
        ("handling", "words"),
        [
            ('{"priority": "first"}', "priority: Input should be 'high', 'normal' or 'low'."),
            ('{"speed": 2}', "speed: this name is not known."),
            ('{"deadline_seconds": 0}', "deadline_seconds: Input should be greater than 0."),
        ],
    )
    def test_that_cannot_be_is_refused(
        self, handling: str, words: str, http: httpx.Client, png: Png
    ) -> None:
        answer = post_pair(http, png(64, 48), png(64, 48, True), data={"handling": handling})
        assert problem_of(answer) == (422, "invalid-option", words)


class TestCameras:
    """Jobs may have the service open what its operator allows, and no other host or port."""

    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        allowed = "sim://studio ptp+ip://10.0.0.7 gphoto2://usb"
        return settings.model_copy(update={"cameras": allowed})

    @pytest.mark.parametrize(
        "address",
        [
            "sim://studio",
            "sim://studio?lights=3",
            "ptp+ip://10.0.0.7",
            "ptp+ip://10.0.0.7:15741",
            "gphoto2://usb:001,004",
        ],
    )
    def test_an_allowed_one_is_taken(self, address: str, http: httpx.Client) -> None:
        answer = http.post("/jobs", json={"capture": {"camera": address}})
        assert answer.status_code == 202

    @pytest.mark.parametrize(
        "address", ["ptp+ip://10.0.0.70", "ptp+ip://10.0.0.7.evil.example", "ptp+usb://123"]
    )
    def test_another_one_is_not(self, address: str, http: httpx.Client, context: Context) -> None:
        answer = http.post("/jobs", json={"capture": {"camera": address}})
        status, kind, sentence = problem_of(answer)
        assert (status, kind) == (403, "foreign-camera") and "LIGHTLAYERS_CAMERAS" in sentence
        assert rows_of(context) == []


@pytest.mark.parametrize("address", ["ptp+ip://127.0.0.1:22", "gphoto2://ptpip:127.0.0.1:22"])
def test_nobody_has_the_service_knock_at_ports(address: str, http: httpx.Client) -> None:
    answer = http.post("/jobs", json={"capture": {"camera": address}})
    assert problem_of(answer)[:2] == (403, "foreign-camera")
