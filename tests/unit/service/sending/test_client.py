from __future__ import annotations

import io
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
import sqlalchemy as sa

from pipeline.options import Options
from service.api.context import Context
from service.rows import attempts, tables
from service.sending.client import Client, Job
from service.sending.failures import RefusedError, ServiceAwayError
from tests.unit.service.asking import bearing, rows_of

Png = Callable[..., bytes]
Finish = Callable[[str, dict[str, bytes]], None]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder, for results."""
    path = tmp_path / "out"
    path.mkdir()
    return path


def _ignore(_stage: str, _fraction: float) -> None:
    return


def test_a_pair_is_sent_with_its_options(client: Client, png: Png, context: Context) -> None:
    job = client.submit_pair(png(64, 48), png(64, 48, True), Options(lights=2))
    assert (job["state"], job["options"]) == ("queued", {"lights": 2})
    assert context.storage.get(f"jobs/{job['id']}/inputs/no_flash") == png(64, 48)


def test_a_default_that_is_set_is_sent_for_kept_calibrations_give_way_to_it(
    client: Client, png: Png
) -> None:
    options = Options(flash_spectrum="xenon")
    job = client.submit_pair(png(64, 48), png(64, 48, True), options)
    assert job["options"] == {"flash_spectrum": "xenon"}
    assert client.submit_capture("sim://studio", options)["options"] == job["options"]


def _lose(client: Client, monkeypatch: pytest.MonkeyPatch, method: str, answers: int) -> None:
    """Let the first answers to a method break off; it is tried again without a pause."""
    stream, left = client._http.stream, [None] * answers

    @contextmanager
    def lossy(verb: str, *arguments: Any, **more: Any) -> Iterator[httpx.Response]:
        with stream(verb, *arguments, **more) as response:
            if verb == method and left:
                left.pop()
                raise httpx.ReadError("the connection broke")
            yield response

    monkeypatch.setattr(client._http, "stream", lossy)
    monkeypatch.setattr("service.sending.client._FIRST_PAUSE_SECONDS", 0.0)


def test_a_pair_whose_answer_is_lost_is_sent_again_and_is_one_job(
    client: Client, png: Png, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    _lose(client, monkeypatch, "POST", 2)
    job = client.submit_pair(png(64, 48), png(64, 48, True), Options())
    assert [row.id for row in rows_of(context)] == [job["id"]]


def test_a_job_is_waited_for_while_the_service_is_away(
    client: Client, finish: Finish, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = client.submit_capture("sim://studio", Options())
    finish(job["id"], {})
    _lose(client, monkeypatch, "GET", 3)
    assert client.wait(job, _ignore)["state"] == "succeeded"


def test_a_service_that_stays_away_is_given_up(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = client.submit_capture("sim://studio", Options())
    _lose(client, monkeypatch, "GET", 1)
    monkeypatch.setattr("service.sending.client._PATIENCE_SECONDS", -1.0)
    with pytest.raises(ServiceAwayError, match="does not answer"):
        client.wait(job, _ignore)


def _separated(client: Client, finish: Finish, files: dict[str, bytes]) -> Job:
    """A job that has succeeded with these results, as wait gives it."""
    job = client.submit_capture("sim://studio", Options())
    finish(job["id"], files)
    return client.wait(job, _ignore)


def test_results_are_fetched_when_the_job_is_done(
    client: Client, finish: Finish, folder: Path
) -> None:
    client.download(
        _separated(client, finish, {"lamp1.jpg": b"light", "manifest.json": b"{}"}), folder
    )
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {
        "lamp1.jpg": b"light",
        "manifest.json": b"{}",
    }


def _break(
    client: Client, monkeypatch: pytest.MonkeyPatch, downloads: int, seconds: float = 0.0
) -> None:
    """Let the first downloads break off after a part that takes so long; no pause follows."""
    stream, left, now = client._http.stream, [None] * downloads, [0.0]

    @contextmanager
    def lossy(verb: str, path: str, **more: Any) -> Iterator[httpx.Response]:
        with stream(verb, path, **more) as response:
            if "/results/" in path and left:
                left.pop()
                monkeypatch.setattr(response, "iter_bytes", partly)
            yield response

    def partly(*_arguments: object) -> Iterator[bytes]:
        yield b"li"
        now[0] += seconds
        raise httpx.RemoteProtocolError("peer closed connection without sending complete body")

    monkeypatch.setattr(client._http, "stream", lossy)
    monkeypatch.setattr("service.sending.client._FIRST_PAUSE_SECONDS", 0.0)
    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=lambda _seconds: None)
    monkeypatch.setattr("service.sending.client.time", clock)


@pytest.mark.parametrize("seconds", [0.0, 400.0], ids=["at once", "after long"])
def test_a_download_that_breaks_off_is_tried_again(
    seconds: float,
    client: Client,
    finish: Finish,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    job = _separated(client, finish, {"lamp1.jpg": b"light", "manifest.json": b"{}"})
    _break(client, monkeypatch, 3 if seconds == 0 else 1, seconds)
    client.download(job, folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {
        "lamp1.jpg": b"light",
        "manifest.json": b"{}",
    }


def test_a_download_that_is_given_up_leaves_no_part_of_it(
    client: Client, finish: Finish, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = _separated(client, finish, {"lamp1.jpg": b"light"})
    _break(client, monkeypatch, 1)
    monkeypatch.setattr("service.sending.client._PATIENCE_SECONDS", -1.0)
    with pytest.raises(ServiceAwayError, match="does not answer"):
        client.download(job, folder)
    assert list(folder.iterdir()) == []


def test_what_is_no_longer_there_is_not_asked_for_again(
    client: Client, finish: Finish, folder: Path, http: httpx.Client
) -> None:
    job = _separated(client, finish, {"lamp1.jpg": b"light"})
    http.delete(job["links"]["self"]).raise_for_status()
    with pytest.raises(RefusedError):
        client.download(job, folder)
    assert list(folder.iterdir()) == []


def test_names_of_results_do_not_lead_out_of_the_folder(
    client: Client, finish: Finish, tmp_path: Path
) -> None:
    job = _separated(client, finish, {"lamp1.jpg": b"light"})
    job["files"][0]["name"] = "../lamp1.jpg"  # as a wicked service might say
    (tmp_path / "out").mkdir()
    client.download(job, tmp_path / "out")
    assert (tmp_path / "out" / "lamp1.jpg").read_bytes() == b"light"
    assert not (tmp_path / "lamp1.jpg").exists()


def test_progress_is_told(
    client: Client, context: Context, finish: Finish, http: httpx.Client
) -> None:
    job = client.submit_capture("sim://studio", Options())
    with context.engine.begin() as connection:
        held = attempts.claim(connection, job["id"], "a worker")
        assert held is not None
        attempts.report(connection, held, "layers", 0.5)
    told: list[tuple[str, float]] = []

    def report(stage: str, fraction: float) -> None:
        told.append((stage, fraction))
        with context.engine.begin() as connection:
            attempts.release(connection, held)
        finish(job["id"], {})

    client.wait(http.get(job["links"]["self"]).json(), report)
    assert told == [("layers", 0.5)]


def test_a_refusal_is_told_in_the_services_words(client: Client, png: Png) -> None:
    with pytest.raises(RefusedError, match="without the flash"):
        client.submit_pair(b"no picture", png(64, 48), Options())


@pytest.mark.parametrize(("status", "kind"), [(422, RefusedError), (500, ServiceAwayError)])
def test_a_failed_job_is_told_by_its_reason(
    status: int, kind: type[Exception], client: Client, context: Context
) -> None:
    job = client.submit_capture("sim://studio", Options())
    problem = {
        "type": "urn:lightlayers:problem:x",
        "title": "X",
        "status": status,
        "detail": "The pair is black.",
        "retryable": False,
        "trace_id": "0",
    }
    with context.engine.begin() as connection:
        held = attempts.claim(connection, job["id"], "a worker")
        assert held is not None
        attempts.fail(connection, held, problem)
    with pytest.raises(kind, match=r"^The pair is black\.$"):
        client.wait(job, _ignore)


def test_a_canceled_job_is_told(client: Client, http: httpx.Client) -> None:
    job = client.submit_capture("sim://studio", Options())
    http.post(job["links"]["cancel"])
    with pytest.raises(RefusedError, match="canceled"):
        client.wait(job, _ignore)


def test_a_server_of_something_else_is_not_asked_again(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = client.submit_capture("sim://studio", Options())
    asked = []

    def strange(request: httpx.Request) -> httpx.Response:
        asked.append(request.url.path)
        return httpx.Response(200, text="a page")

    other = httpx.Client(base_url="http://other", transport=httpx.MockTransport(strange))
    monkeypatch.setattr("service.sending.client._FIRST_PAUSE_SECONDS", 0.0)
    monkeypatch.setattr("service.sending.client._PATIENCE_SECONDS", 0.2)
    with other, monkeypatch.context() as patch, pytest.raises(ServiceAwayError):
        patch.setattr(client, "_http", other)
        client.wait(job, _ignore)
    assert asked == [job["links"]["self"]]


def test_a_job_that_has_expired_is_told(client: Client, context: Context) -> None:
    job = client.submit_capture("sim://studio", Options())
    with context.engine.begin() as connection:
        connection.execute(sa.update(tables.jobs).values(state="expired"))
    with pytest.raises(RefusedError, match="expired"):
        client.wait(job, _ignore)


@pytest.mark.parametrize("status", [200, 404, 502])
@pytest.mark.parametrize(
    "body",
    [
        b"<html>",
        b"\xff",
        b"[]",
        b'{"detail": "no status"}',
        b'{"status": "error", "detail": "no such page"}',
        b'{"state": "queued", "stage": null, "links": {}}',
        b'{"state": "failed", "stage": 1, "fraction": 1, "error": 1, "files": 1}',
    ],
)
def test_another_server_is_recognised(
    body: bytes, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.sending.client._PATIENCE_SECONDS", -1.0)
    job = {"state": "queued", "stage": None, "links": {"self": "/jobs/1"}}
    with _server(status, body) as url, Client(url) as client:
        uses: list[Callable[[], object]] = [
            lambda: client.submit_pair(b"", b"", Options()),
            lambda: client.submit_capture("sim://studio", Options()),
            lambda: client.wait(job, _ignore),
        ]
        for use in uses:
            with pytest.raises(ServiceAwayError, match=rf"no lightlayers .*\(status {status}\)"):
                use()


@pytest.mark.parametrize(("status", "body"), [(200, b"<html>"), (200, b"[]"), (404, b"{}")])
def test_another_server_is_not_ready(status: int, body: bytes) -> None:
    refused = pytest.raises(ServiceAwayError, match=rf"no lightlayers .*\(status {status}\)")
    with _server(status, body) as url, Client(url) as client, refused:
        client.check_ready()


def test_a_size_that_a_proxy_refuses_is_told_as_such() -> None:
    told = r"A proxy before the service .* \(status 413\): raise its limit, .*UPLOAD_BYTES\."
    refused = pytest.raises(ServiceAwayError, match=told)
    with _server(413, b"<html>") as url, Client(url) as client, refused as away:
        client.create_upload(5)
    assert (away.value.status, away.value.passes) == (413, False)


def test_a_file_goes_up_in_pieces_and_becomes_a_job(
    client: Client, png: Png, context: Context
) -> None:
    photographs = {"no_flash": png(64, 48), "flash": png(64, 48, True)}
    uploads = {}
    for frame, data in photographs.items():
        uploads[frame] = client.create_upload(len(data))
        assert client.upload_offset(uploads[frame]) == 0
        client.append_to_upload(uploads[frame], io.BytesIO(data[:100]), 0, 100)
        assert client.upload_offset(uploads[frame]) == 100
        client.append_to_upload(uploads[frame], io.BytesIO(data), 100, len(data))
    job = client.submit_uploads(uploads, {"lights": 2}, "once")
    assert job["options"] == {"lights": 2}
    assert context.storage.get(f"jobs/{job['id']}/inputs/flash") == photographs["flash"]
    assert client.upload_offset(uploads["flash"]) is None
    assert client.submit_uploads(uploads, {"lights": 2}, "once")["id"] == job["id"]


@pytest.mark.parametrize(
    ("scope", "status", "words"),
    [(None, 401, "needs a key that is good"), ("read", 403, "the scope submit")],
)
def test_a_key_that_may_not_ask_for_an_upload_is_told(
    http: httpx.Client, context: Context, scope: str | None, status: int, words: str
) -> None:
    made = bearing(context, scope or "submit")["authorization"].removeprefix("Bearer ")
    asked = pytest.raises(RefusedError, match=words)
    with Client(str(http.base_url), made if scope else None) as client, asked as refused:
        client.upload_offset("1")
    assert (refused.value.status, refused.value.final) == (status, False)


def test_a_service_that_cannot_tell_of_an_upload_is_away_for_now(
    client: Client, context: Context
) -> None:
    upload = client.create_upload(5)
    with context.engine.begin() as connection:
        connection.exec_driver_sql("ALTER TABLE uploads RENAME TO gone")
    with pytest.raises(ServiceAwayError, match="try again later") as away:
        client.upload_offset(upload)
    assert (away.value.status, away.value.passes) == (503, True)


@pytest.mark.parametrize(("status", "passes"), [(500, False), (503, True), (507, False)])
def test_of_what_cannot_tell_of_an_upload_the_service_being_away_alone_passes(
    status: int, passes: bool
) -> None:
    answer = httpx.Response(status, headers={"trace-id": "0" * 32})
    with Client("http://127.0.0.1:9") as client:
        client._http = httpx.Client(
            base_url="http://127.0.0.1:9", transport=httpx.MockTransport(lambda _asked: answer)
        )
        with pytest.raises(ServiceAwayError, match="try again later") as away:
            client.upload_offset("1")
    assert (away.value.status, away.value.passes) == (status, passes)


@pytest.mark.parametrize("status", [401, 403, 500, 503])
def test_another_server_that_knows_no_uploads_is_told(status: int) -> None:
    away = pytest.raises(ServiceAwayError, match=rf"no lightlayers .*\(status {status}\)")
    with _server(status, b"") as url, Client(url) as client, away:
        client.upload_offset("1")


def test_a_refusal_says_whether_it_is_for_good(client: Client) -> None:
    with pytest.raises(RefusedError) as refused:
        client.submit_uploads({"no_flash": "0", "flash": "1"}, {}, "once")
    assert (refused.value.status, refused.value.final) == (422, True)
    with pytest.raises(RefusedError, match="Upload-Length") as refused:
        client.create_upload(-1)
    assert (refused.value.status, refused.value.final) == (400, True)
    upload = client.create_upload(5)
    with pytest.raises(RefusedError, match="goes on at byte 0") as refused:
        client.append_to_upload(upload, io.BytesIO(b"light"), 3, 5)
    assert (refused.value.status, refused.value.final) == (409, False)
    with pytest.raises(ServiceAwayError, match="have come") as unfinished:
        client.submit_uploads({"no_flash": upload, "flash": upload}, {}, "once")
    assert (unfinished.value.status, unfinished.value.passes) == (409, True)


@pytest.mark.parametrize("status", [400, 401, 404, 422])
def test_the_refusal_of_another_server_is_not_for_good(status: int) -> None:
    body = b'{"status": 422, "detail": "No.", "type": "about:blank"}'
    with _server(status, body) as url, Client(url) as client:
        with pytest.raises(RefusedError) as refused:
            client.submit_uploads({}, {}, "once")
        assert (refused.value.status, refused.value.final) == (status, False)


@pytest.mark.parametrize(
    "body",
    [b"<html>", b"[]", b'{"id": "x"}', b'{"id": "x", "inputs": {"flash": null}}'],
)
@pytest.mark.parametrize("status", [200, 202])
def test_an_answer_of_another_server_is_no_receipt(status: int, body: bytes) -> None:
    with _server(status, body) as url, Client(url) as client:
        for use in (
            lambda: client.submit_uploads({"flash": "1"}, {}, "once"),
            lambda: client.create_upload(5),
            lambda: client.upload_offset("1"),
            lambda: client.append_to_upload("1", io.BytesIO(b"light"), 0, 5),
        ):
            with pytest.raises(ServiceAwayError, match=rf"no lightlayers .*\(status {status}\)"):
                use()


@contextmanager
def _server(status: int, body: bytes) -> Iterator[str]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.rfile.read(int(self.headers.get("content-length", 0)))
            self.send_response(status)
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(body)

        def do_POST(self) -> None:
            self.do_GET()

        def do_PATCH(self) -> None:
            self.do_GET()

        def do_HEAD(self) -> None:
            self.do_GET()

        def log_message(self, format: str, *arguments: object) -> None:
            """Stay quiet."""

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()
