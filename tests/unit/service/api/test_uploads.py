"""Uploads as https://tus.io/protocols/resumable-upload has them, and jobs made of them."""

from __future__ import annotations

import base64
import hashlib
import socket
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import Any

import httpx
import pytest
import sqlalchemy as sa

from service.api.context import Context
from service.rows import tables, uploads
from service.settings import Settings
from service.storage.folder import FolderStorage
from tests.unit.service.asking import problem_of
from tests.unit.service.uploading import PIECE, TUS, create, offset_of, patch

Png = Callable[..., bytes]


def checksum(algorithm: str, data: bytes) -> dict[str, str]:
    digest = hashlib.new(algorithm, data).digest()
    return {"Upload-Checksum": f"{algorithm} {base64.b64encode(digest).decode()}"}


class TestProtocol:
    def test_the_service_tells_what_it_speaks(self, http: httpx.Client) -> None:
        answer = http.options("/uploads")
        assert (answer.status_code, answer.content) == (204, b"")
        told = {name: text for name, text in answer.headers.items() if name.startswith("tus")}
        assert told == {
            "tus-resumable": "1.0.0",
            "tus-version": "1.0.0",
            "tus-extension": "creation,creation-with-upload,expiration,checksum,termination",
            "tus-max-size": str(512 * 1024 * 1024),
            "tus-checksum-algorithm": "sha256,sha1",
        }

    def test_an_upload_comes_piece_by_piece(self, http: httpx.Client) -> None:
        place = create(http, 6, **{"Upload-Metadata": "filename aG9saWRheQ=="})
        assert patch(http, place, 0, b"abcd").headers["upload-offset"] == "4"
        answer = http.head(place, headers=TUS)
        assert answer.status_code == 200
        assert answer.headers["upload-offset"] == "4"
        assert answer.headers["upload-length"] == "6"
        assert answer.headers["upload-metadata"] == "filename aG9saWRheQ=="
        assert answer.headers["cache-control"] == "no-store"
        left = parsedate_to_datetime(answer.headers["upload-expires"]).timestamp() - time.time()
        assert 86400 - 120 < left < 86400 + 120
        last = patch(http, place, 4, b"ef")
        assert (last.status_code, last.headers["upload-offset"]) == (204, "6")
        assert last.headers["tus-resumable"] == "1.0.0"
        assert patch(http, place, 6, b"").status_code == 204

    def test_the_first_piece_may_come_with_the_creation(self, http: httpx.Client) -> None:
        headers = {**PIECE, "Upload-Length": "6"}
        answer = http.post("/uploads", headers=headers, content=b"abc")
        assert (answer.status_code, answer.headers["upload-offset"]) == (201, "3")
        assert offset_of(http, answer.headers["location"]) == 3

    @pytest.mark.parametrize(
        ("data", "more", "status"),
        [
            (b"abc", checksum("sha1", b"abX"), 460),
            (b"abcdefg", {}, 413),
            (iter([b"abcd", b"efg"]), {}, 413),
        ],
    )
    def test_a_creation_whose_piece_is_refused_leaves_nothing(
        self, data: Any, more: dict[str, str], status: int, http: httpx.Client, context: Context
    ) -> None:
        headers = {**PIECE, "Upload-Length": "6", **more}
        assert problem_of(http.post("/uploads", headers=headers, content=data))[0] == status
        with context.engine.connect() as connection:
            assert connection.execute(sa.select(tables.uploads)).all() == []

    def test_an_upload_may_come_in_so_many_pieces(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(uploads, "MAX_PARTS", 2)
        place = create(http, 3)
        assert [patch(http, place, at, b"a").status_code for at in (0, 1)] == [204, 204]
        detail = "The upload came in 2 pieces; send another in larger ones."
        assert problem_of(patch(http, place, 2, b"a")) == (400, "malformed-request", detail)
        assert offset_of(http, place) == 2

    def test_a_method_may_be_overridden(self, http: httpx.Client) -> None:
        place = create(http, 3)
        headers = {**PIECE, "Upload-Offset": "0", "X-HTTP-Method-Override": "PATCH"}
        assert http.post(place, headers=headers, content=b"abc").status_code == 204
        assert offset_of(http, place) == 3

    @pytest.mark.parametrize("method", ["POST", "HEAD", "PATCH", "DELETE"])
    @pytest.mark.parametrize("version", [{}, {"Tus-Resumable": "0.2.2"}])
    def test_other_versions_are_refused(
        self, method: str, version: dict[str, str], http: httpx.Client
    ) -> None:
        place = create(http, 3)
        headers = {**PIECE, "Upload-Offset": "0", "Upload-Length": "3"}
        del headers["Tus-Resumable"]
        path = "/uploads" if method == "POST" else place
        answer = http.request(method, path, headers=headers | version)
        assert (answer.status_code, answer.headers["tus-version"]) == (412, "1.0.0")
        assert offset_of(http, place) == 0

    @pytest.mark.parametrize(
        ("headers", "status"),
        [
            ({}, 422),
            ({"Upload-Length": "-1"}, 400),
            ({"Upload-Length": ""}, 400),
            ({"Upload-Length": "1e3"}, 400),
            ({"Upload-Length": "9" * 30}, 400),
            ({"Upload-Length": "9" * 15}, 413),
            ({"Upload-Defer-Length": "1"}, 422),
            ({"Upload-Length": "3", "Upload-Metadata": "x" * 5000}, 400),
            ({"Upload-Length": "3", "Upload-Checksum": "md5 AAAA"}, 400),
        ],
    )
    def test_an_upload_that_cannot_be_is_refused(
        self, headers: dict[str, str], status: int, http: httpx.Client
    ) -> None:
        answer = http.post("/uploads", headers=TUS | headers)
        assert problem_of(answer)[0] == status
        assert answer.headers["tus-resumable"] == "1.0.0"

    @pytest.mark.parametrize(
        ("headers", "status", "kind"),
        [
            ({"Upload-Offset": "2"}, 409, "upload-offset"),
            ({"Upload-Offset": "0"}, 409, "upload-offset"),
            ({"Upload-Offset": "-1"}, 400, "malformed-request"),
            ({"Upload-Offset": "three"}, 400, "malformed-request"),
            ({"Content-Type": "image/jpeg"}, 415, "unsupported-media-type"),
            ({"Upload-Checksum": "sha1"}, 400, "malformed-request"),
            ({"Upload-Checksum": "crc32 AAAA"}, 400, "malformed-request"),
            ({"Upload-Checksum": "sha256 !"}, 400, "malformed-request"),
        ],
    )
    def test_a_piece_that_cannot_be_is_refused(
        self, headers: dict[str, str], status: int, kind: str, http: httpx.Client
    ) -> None:
        place = create(http, 6)
        patch(http, place, 0, b"abc")
        answer = http.patch(place, content=b"de", headers=PIECE | {"Upload-Offset": "3"} | headers)
        assert problem_of(answer)[:2] == (status, kind)
        assert offset_of(http, place) == 3

    def test_more_bytes_than_the_length_are_refused(
        self, http: httpx.Client, context: Context
    ) -> None:
        place = create(http, 6)
        status, kind, detail = problem_of(patch(http, place, 0, b"abcdefg"))
        assert (status, kind) == (413, "upload-too-large")
        assert "7 bytes" in detail and "6 of the upload" in detail
        headers = {**PIECE, "Upload-Offset": "0"}
        answer = http.patch(place, content=iter([b"abcd", b"efg"]), headers=headers)
        assert problem_of(answer)[:2] == (413, "upload-too-large")
        assert offset_of(http, place) == 0
        assert context.storage.list("") == []

    def test_what_came_in_earlier_pieces_counts_for_the_length(self, http: httpx.Client) -> None:
        place = create(http, 6)
        patch(http, place, 0, b"abc")
        headers = {**PIECE, "Upload-Offset": "3"}
        answer = http.patch(place, content=iter([b"de", b"fg"]), headers=headers)
        assert problem_of(answer) == (
            413,
            "upload-too-large",
            "The upload has 6 bytes by its Upload-Length; more came.",
        )
        assert offset_of(http, place) == 3
        assert patch(http, place, 3, b"def").headers["upload-offset"] == "6"

    @pytest.mark.parametrize("algorithm", ["sha1", "sha256"])
    def test_a_checksum_that_does_not_fit_discards_the_piece(
        self, algorithm: str, http: httpx.Client, context: Context
    ) -> None:
        place = create(http, 6)
        answer = patch(http, place, 0, b"abX", **checksum(algorithm, b"abc"))
        assert problem_of(answer)[:2] == (460, "checksum-mismatch")
        assert offset_of(http, place) == 0
        assert context.storage.list("") == []
        assert patch(http, place, 0, b"abc", **checksum(algorithm, b"abc")).status_code == 204
        assert offset_of(http, place) == 3

    def test_a_removed_upload_leaves_nothing(self, http: httpx.Client, context: Context) -> None:
        place = create(http, 6)
        patch(http, place, 0, b"abc")
        assert http.delete(place, headers=TUS).status_code == 204
        assert context.storage.list("") == []
        assert problem_of(patch(http, place, 3, b"def"))[:2] == (404, "unknown-upload")
        assert http.head(place, headers=TUS).status_code == 404
        assert problem_of(http.delete(place, headers=TUS))[0] == 404

    def test_an_expired_upload_is_gone(self, http: httpx.Client, context: Context) -> None:
        place = create(http, 6)
        with context.engine.begin() as connection:
            connection.execute(sa.update(tables.uploads).values(expires=1.0))
        assert problem_of(patch(http, place, 0, b"abc"))[:2] == (410, "upload-expired")
        assert http.head(place, headers=TUS).status_code == 410

    def test_an_upload_of_another_owner_is_unknown(
        self, http: httpx.Client, context: Context
    ) -> None:
        place = create(http, 6)
        with context.engine.begin() as connection:
            connection.execute(sa.update(tables.uploads).values(owner="somebody"))
        assert problem_of(patch(http, place, 0, b"abc"))[:2] == (404, "unknown-upload")
        assert problem_of(http.delete(place, headers=TUS))[0] == 404
        assert http.head(place, headers=TUS).status_code == 404


def test_uploads_to_a_store_that_hangs_leave_threads_to_others(
    http: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken, go_on = threading.Semaphore(0), threading.Event()
    put = FolderStorage.put

    def wait(storage: FolderStorage, key: str, data: bytes | Path) -> None:
        taken.release()
        go_on.wait(120)
        put(storage, key, data)

    places = [create(http, 5) for _ in range(45)]
    monkeypatch.setattr(FolderStorage, "put", wait)
    with ThreadPoolExecutor(len(places)) as pool:
        sent = [pool.submit(patch, http, place, 0, b"light") for place in places]
        try:
            for _ in range(40):  # as many as are stored at a time
                assert taken.acquire(timeout=60)
            assert http.get("/jobs", timeout=60).json()["jobs"] == []
        finally:
            go_on.set()
        assert {each.result().status_code for each in sent} == {204}
    assert {offset_of(http, place) for place in places} == {5}


def _begin_piece(
    http: httpx.Client, place: str, length: int, sent: bytes, more: str = ""
) -> socket.socket:
    """Send the head of a piece and the beginning of it."""
    connection = socket.create_connection((http.base_url.host, http.base_url.port or 80), 60)
    head = f"PATCH {place} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n"
    head += "Tus-Resumable: 1.0.0\r\nUpload-Offset: 0\r\n"
    head += f"Content-Type: application/offset+octet-stream\r\n{more}\r\n"
    connection.sendall(head.encode() + sent)
    return connection


def _await(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.02)


class TestBreaks:
    @pytest.fixture
    def arrived(self, context: Context) -> Callable[[], int]:
        """Bytes of a piece that is coming."""
        return lambda: sum(
            path.stat().st_size for path in context.settings.data_dir.glob("work/*/part")
        )

    def test_what_came_before_a_break_stays(
        self, http: httpx.Client, arrived: Callable[[], int]
    ) -> None:
        place = create(http, 100_000)
        with _begin_piece(http, place, 100_000, b"x" * 30_000):
            _await(lambda: arrived() == 30_000)
            assert offset_of(http, place) == 0
        _await(lambda: offset_of(http, place) == 30_000)
        assert patch(http, place, 30_000, b"x" * 70_000).status_code == 204

    def test_large_pieces_are_kept_while_they_come(self, http: httpx.Client) -> None:
        size = 8 * 1024 * 1024
        place = create(http, 3 * size)
        with _begin_piece(http, place, 3 * size, b"x" * (size + 100_000)):
            _await(lambda: size <= offset_of(http, place) <= size + 100_000)

    def test_a_piece_with_a_checksum_counts_whole_or_not_at_all(
        self, http: httpx.Client, arrived: Callable[[], int], context: Context
    ) -> None:
        place = create(http, 100)
        with _begin_piece(http, place, 100, b"x" * 30, "Upload-Checksum: sha1 AAAA\r\n"):
            _await(lambda: arrived() == 30)
        _await(lambda: not list((context.settings.data_dir / "work").iterdir()))
        assert offset_of(http, place) == 0
        assert context.storage.list("") == []

    def test_an_upload_that_is_removed_while_a_piece_is_stored_is_gone(
        self, http: httpx.Client, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        place = create(http, 6)
        flush = FolderStorage.flush

        def remove(storage: FolderStorage, keys: Iterable[str]) -> None:
            assert http.delete(place, headers=TUS).status_code == 204
            flush(storage, keys)

        monkeypatch.setattr(FolderStorage, "flush", remove)
        assert problem_of(patch(http, place, 0, b"abc"))[:2] == (409, "upload-offset")
        assert context.storage.list("") == []

    def test_of_two_requests_at_once_the_later_one_is_refused(
        self, http: httpx.Client, context: Context
    ) -> None:
        place = create(http, 6)
        with _begin_piece(http, place, 6, b"abc") as first:
            assert patch(http, place, 0, b"xyz").status_code == 204
            first.sendall(b"def")
            assert first.recv(1000).startswith(b"HTTP/1.1 409 ")
        assert offset_of(http, place) == 3
        assert len(context.storage.list("")) == 1


class TestShortPauses:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"pause_seconds": 1})

    @pytest.mark.parametrize(("more", "kept"), [("", 30), ("Upload-Checksum: sha1 AAAA\r\n", 0)])
    def test_what_came_before_a_stall_stays(self, more: str, kept: int, http: httpx.Client) -> None:
        place = create(http, 100)
        with _begin_piece(http, place, 100, b"x" * 30, more) as stalled:
            assert stalled.recv(1000).startswith(b"HTTP/1.1 408 ")
        assert offset_of(http, place) == kept


class TestLimits:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"upload_bytes": 1000})

    def test_an_upload_larger_than_the_limit_is_refused(self, http: httpx.Client) -> None:
        assert http.options("/uploads").headers["tus-max-size"] == "1000"
        answer = http.post("/uploads", headers={**TUS, "Upload-Length": "1001"})
        status, kind, detail = problem_of(answer)
        assert (status, kind) == (413, "upload-too-large")
        assert "1,001 bytes" in detail and "1,000" in detail
        create(http, 1000)


class TestLowDisk:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"free_bytes": 2**62})

    def test_uploads_are_refused(self, http: httpx.Client) -> None:
        answer = http.post("/uploads", headers={**TUS, "Upload-Length": "3"})
        assert problem_of(answer)[:2] == (507, "storage-full")
