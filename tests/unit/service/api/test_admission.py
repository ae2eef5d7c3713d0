from __future__ import annotations

import socket
from collections.abc import Callable

import httpx
import pytest

from service.api.context import Context
from service.rows import waiting
from service.settings import Settings
from service.storage.folder import FolderStorage
from tests.unit.service.asking import post_capture, post_pair, problem_of, rows_of

Png = Callable[..., bytes]

_TUS = {"Tus-Resumable": "1.0.0"}
_UPLOAD = {**_TUS, "Upload-Length": "3"}


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
        monkeypatch.setattr(waiting, "count_queued", lambda _connection, _owner=None: next(counts))
        answer = post_pair(http, png(64, 48), png(64, 48, True))
        assert problem_of(answer)[:2] == (429, "queue-full")
        assert context.storage.list("") == []

    def test_no_upload_is_begun_for_a_full_queue(self, http: httpx.Client) -> None:
        """What comes would only wait; one that was begun before goes on."""
        first = post_capture(http)
        begun = http.post("/uploads", headers=_UPLOAD)
        post_capture(http)
        refused = http.post("/uploads", headers=_UPLOAD)
        assert problem_of(refused)[:2] == (429, "queue-full")
        assert int(refused.headers["retry-after"]) > 0
        headers = {**_TUS, "Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
        assert http.patch(begun.headers["location"], content=b"x", headers=headers).is_success
        http.post(first["links"]["cancel"])
        assert http.post("/uploads", headers=_UPLOAD).status_code == 201

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
        assert told == [(f"no room for a job: {detail}", None)] * 2  # of which disk
        assert rows_of(context) == []
        assert context.storage.list("") == []

    def test_pieces_of_uploads_are_refused(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with monkeypatch.context() as roomy:
            roomy.setattr(FolderStorage, "free_bytes", lambda _storage: 2**62)
            begun = http.post("/uploads", headers=_UPLOAD).headers["location"]
        headers = {**_TUS, "Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
        assert problem_of(http.patch(begun, content=b"x", headers=headers))[:2] == (
            507,
            "storage-full",
        )
        assert http.head(begun, headers=_TUS).headers["upload-offset"] == "0"

    @pytest.mark.parametrize("path", ["/jobs", "/calibrations"])
    def test_that_is_told_before_the_body_is_read(self, path: str, http: httpx.Client) -> None:
        assert _answer_to_a_head(http, path).startswith("HTTP/1.1 507 ")

    def test_a_store_that_is_no_folder_has_no_disk_to_fill(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(FolderStorage, "free_bytes", lambda _storage: None)
        assert post_capture(http)["state"] == "queued"

    def test_the_job_of_a_key_is_still_given(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with monkeypatch.context() as roomy:
            roomy.setattr(FolderStorage, "free_bytes", lambda _storage: 2**62)
            first = post_capture(http, **{"idempotency-key": "once"})
        assert post_capture(http, **{"idempotency-key": "once"})["id"] == first["id"]


def _answer_to_a_head(http: httpx.Client, path: str) -> str:
    """Send the head of a large upload and wait for the answer before sending more."""
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 90000\r\n"
    head += "Content-Type: multipart/form-data; boundary=edge\r\n\r\n"
    with socket.create_connection((http.base_url.host, http.base_url.port or 80), 60) as client:
        client.sendall(head.encode())
        return client.recv(1000).decode()
