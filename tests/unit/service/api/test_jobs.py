from __future__ import annotations

import hashlib
import json
import socket
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import psycopg
import pytest
import sqlalchemy as sa

from drivers import capture_pair, open_camera
from service.api.context import Context
from service.rows import attempts, expiry, jobs
from service.settings import Settings
from tests.jpeg_xl import in_jpeg_xl
from tests.png_bombs import png_of
from tests.unit.service.asking import bearing, post_capture, post_pair, problem_of, queued
from tests.unit.service.studio import PATH, hold, with_cameras

Png = Callable[..., bytes]


def test_an_upload_becomes_a_queued_job(http: httpx.Client, png: Png, context: Context) -> None:
    answer = post_pair(http, png(64, 48), png(64, 48, True), data={"options": '{"lights": 2}'})
    assert answer.status_code == 202
    job = answer.json()
    assert answer.headers["location"] == f"/jobs/{job['id']}" == job["links"]["self"]
    assert (job["state"], job["position"], job["attempt"]) == ("queued", 1, 0)
    assert (job["options"], job["capture"], job["error"]) == ({"lights": 2}, None, None)
    assert job["links"]["cancel"] == f"/jobs/{job['id']}/cancel"
    assert job["links"]["results"] is None
    assert http.get(f"/jobs/{job['id']}").json() == job
    sent = {"no_flash": png(64, 48), "flash": png(64, 48, True)}
    digests = {frame: hashlib.sha256(data).hexdigest() for frame, data in sent.items()}
    assert job["inputs"] == {frame: {"sha256": digest} for frame, digest in digests.items()}
    for frame, data in sent.items():
        assert context.storage.get(f"jobs/{job['id']}/inputs/{frame}") == data
    assert list((context.settings.data_dir / "work").iterdir()) == []


def test_dngs_in_jpeg_xl_are_taken(http: httpx.Client) -> None:
    with open_camera("sim://studio?width=96&height=64") as camera:
        pair = capture_pair(camera)
    sent = (in_jpeg_xl(shot.best) for shot in (pair.no_flash, pair.flash))

    assert post_pair(http, *sent).status_code == 202


def test_a_capture_becomes_a_queued_job(http: httpx.Client) -> None:
    wanted = {"capture": {"camera": "sim://studio"}, "options": {"lights": 3}}
    job = http.post("/jobs", json=wanted).json()
    assert (job["capture"]["camera"], job["options"]) == ("sim://studio", {"lights": 3})
    assert job["inputs"] is None


def test_names_of_photographs_are_kept_nowhere(
    http: httpx.Client, png: Png, context: Context, caplog: pytest.LogCaptureFixture
) -> None:
    files = {"no_flash": ("holiday.png", png(64, 48)), "flash": ("holiday.png", b"no picture")}
    assert http.post("/jobs", files=files).status_code == 422
    files["flash"] = ("holiday.png", png(64, 48, True))
    assert http.post("/jobs", files=files).status_code == 202
    kept = context.settings.data_dir.rglob("*")
    assert not [path for path in kept if path.is_file() and b"holiday" in path.read_bytes()]
    assert "holiday" not in caplog.text


@pytest.mark.parametrize(
    ("no_flash", "kind"),
    [
        (b"dear diary, today I took photographs", "unreadable-image"),
        (b"", "unreadable-image"),
        (b"\xff\xd8\xff\xe0 and nothing more", "unreadable-image"),
        (b"\x89PNG\r\n\x1a\n", "unreadable-image"),
    ],
)
def test_what_is_no_photograph_is_refused(
    no_flash: bytes, kind: str, http: httpx.Client, png: Png, context: Context
) -> None:
    status, found, detail = problem_of(post_pair(http, no_flash, png(64, 48)))
    assert (status, found) == (422, kind)
    assert "without the flash" in detail
    assert http.get("/jobs").json()["jobs"] == []
    assert context.storage.list("") == []


def test_frames_of_two_sizes_are_refused(http: httpx.Client, png: Png) -> None:
    status, kind, detail = problem_of(post_pair(http, png(64, 48), png(48, 64)))
    assert (status, kind) == (422, "pair-mismatch")
    assert "48" in detail and "64" in detail


def test_a_picture_with_too_many_pixels_is_refused(http: httpx.Client) -> None:
    large = png_of(20_000, 20_000)
    assert problem_of(post_pair(http, large, large))[:2] == (413, "image-too-large")


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ('{"lights": 4}', "invalid-option", "more than three lamps"),
        ('{"lights": 0}', "invalid-option", "lights"),
        ('{"lights": "two"}', "invalid-option", "lights"),
        ('{"lamps": 2}', "invalid-option", "lamps"),
        ('{"exposure_ratio": -1}', "invalid-option", "exposure_ratio"),
        ('{"exposure_ratio": 1e999}', "invalid-option", "exposure_ratio"),
        ('{"outputs": ["all.gif"]}', "invalid-option", "all.gif"),
        ("[]", "invalid-option", "object"),
        ("{", "invalid-option", "JSON"),
        ("", "invalid-option", "JSON"),
    ],
)
def test_options_that_cannot_be_used_are_refused(
    options: str, kind: str, words: str, http: httpx.Client, png: Png
) -> None:
    answer = post_pair(http, png(64, 48), png(64, 48, True), data={"options": options})
    status, found, detail = problem_of(answer)
    assert (status, found) == (422, kind)
    assert words.lower() in detail.lower()


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"flash": b"x"}, "no_flash is missing"),
        ({"no_flash": b"x"}, "flash is missing"),
        ({"no_flash": b"x", "flash": b"y", "third": b"z"}, "'third' is unknown"),
        ({"no_flash": b"x", "Flash": b"y"}, "'Flash' is unknown"),
        ({}, "missing"),
    ],
)
def test_parts_other_than_the_two_frames_are_refused(
    parts: dict[str, bytes], words: str, http: httpx.Client
) -> None:
    files = {name: ("a.jpg", data) for name, data in parts.items()} or {"": ("", b"")}
    status, kind, detail = problem_of(http.post("/jobs", files=files))
    assert (status, kind) == (400, "malformed-request")
    assert words in detail or not parts


def test_parts_are_files_or_texts_by_their_names_alone(http: httpx.Client, png: Png) -> None:
    """Browsers send JSON as a file, and some programs send files without a name."""
    files: dict[str, Any] = {
        "no_flash": (None, png(64, 48)),
        "flash": ("b.heic", png(64, 48, True), "text/plain"),
        "options": ("blob", b'{"lights": 2}', "application/json"),
    }
    answer = http.post("/jobs", files=files)
    assert (answer.status_code, answer.json()["options"]) == (202, {"lights": 2})


def test_a_part_of_any_type_or_none_is_read(http: httpx.Client, png: Png) -> None:
    pair = {"no_flash": png(64, 48), "flash": png(64, 48, True)}
    head = b'--edge\r\nContent-Disposition: form-data; name="%b"; filename="x"\r\n'
    for kind in (b"", b"Content-Type: \r\n", b"Content-Type: application/octet-stream\r\n"):
        body = b"".join(
            head % frame.encode() + kind + b"\r\n" + data + b"\r\n" for frame, data in pair.items()
        )
        headers = {"content-type": "multipart/form-data; boundary=edge"}
        answer = http.post("/jobs", content=body + b"--edge--", headers=headers)
        digests = {name: one["sha256"] for name, one in answer.json()["inputs"].items()}
        assert digests == {name: hashlib.sha256(data).hexdigest() for name, data in pair.items()}


@pytest.mark.parametrize(
    "kind",
    ["text/plain", "image/jpeg", "application/x-www-form-urlencoded", "application/jsonx", ""],
)
def test_other_media_types_are_refused(kind: str, http: httpx.Client) -> None:
    answer = http.post("/jobs", content=b"{}", headers={"content-type": kind})
    assert problem_of(answer)[:2] == (415, "unsupported-media-type")


@pytest.mark.parametrize(
    "header", ["multipart/form-data", "multipart/form-data; boundary=", "multipart/form-data; x"]
)
def test_a_multipart_body_without_a_boundary_is_refused(header: str, http: httpx.Client) -> None:
    answer = http.post("/jobs", content=b"--x\r\n\r\n--x--", headers={"content-type": header})
    assert problem_of(answer)[:2] == (400, "malformed-request")


def test_a_broken_multipart_body_is_refused(http: httpx.Client) -> None:
    headers = {"content-type": "multipart/form-data; boundary=edge"}
    answer = http.post("/jobs", content=b"--edge\r\nnonsense", headers=headers)
    assert problem_of(answer)[:2] == (400, "malformed-request")


def test_a_connection_that_breaks_is_no_fault_of_the_service(
    http: httpx.Client, context: Context, caplog: pytest.LogCaptureFixture
) -> None:
    head = "POST /jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 90000\r\n"
    for kind in ("multipart/form-data; boundary=edge", "application/json"):
        with socket.create_connection((http.base_url.host, http.base_url.port or 80)) as client:
            client.sendall(f"{head}Content-Type: {kind}\r\n\r\n--edge\r\n".encode())
    assert http.get("/jobs").json()["jobs"] == []
    assert context.storage.list("") == []
    assert caplog.messages == []


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"", "JSON"),
        (b"{", "JSON"),
        (b"null", "object"),
        (b"{}", "capture"),
        (b'{"capture": {}}', "camera"),
        (b'{"capture": {"camera": ""}}', "camera"),
        (b'{"capture": {"camera": "sim://studio", "shutter": 1}}', "shutter"),
        (b'{"capture": {"camera": "sim://studio"}, "option": {}}', "option"),
        (b'{"capture": {"camera": "sim://studio"}, "options": {"lights": 9}}', "three lamps"),
        (b"\xff\xfe", "JSON"),
    ],
)
def test_json_that_is_no_capture_is_refused(body: bytes, words: str, http: httpx.Client) -> None:
    answer = http.post("/jobs", content=body, headers={"content-type": "application/json"})
    status, kind, detail = problem_of(answer)
    assert (status, kind) == (422, "invalid-option")
    assert words.lower() in detail.lower()


@pytest.mark.parametrize(
    ("camera", "status", "kind"),
    [
        ("usb://1", 422, "bad-camera-address"),
        ("sim://studio?lights=9", 422, "bad-camera-address"),
        ("sim://attic", 404, "camera-not-found"),
        ("ptp+ip://10.0.0.1", 403, "foreign-camera"),
    ],
)
@pytest.mark.parametrize(("path", "options"), [("/jobs", {}), ("/calibrations", {"kind": "flash"})])
def test_a_camera_that_cannot_be_is_refused_at_once(
    path: str, options: dict[str, str], camera: str, status: int, kind: str, http: httpx.Client
) -> None:
    answer = http.post(path, json={"capture": {"camera": camera}, "options": options})
    assert problem_of(answer)[:2] == (status, kind)
    assert http.get("/jobs").json()["jobs"] == []


def test_json_has_a_limit_that_no_setting_moves(http: httpx.Client) -> None:
    body = {"capture": {"camera": "sim://studio"}, "options": {"camera": "x" * 2**20}}
    assert problem_of(http.post("/jobs", json=body)) == (
        413,
        "upload-too-large",
        "The request is larger than 1,048,576 bytes, which is all this service takes: send less, "
        "like calibrations by name.",
    )


class TestSmallLimits:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"upload_bytes": 100_000})

    def test_a_large_upload_is_refused(self, http: httpx.Client, context: Context) -> None:
        answer = post_pair(http, b"x" * 200_000, b"y")
        status, kind, detail = problem_of(answer)
        assert (status, kind) == (413, "upload-too-large")
        assert "100,000 bytes" in detail and "raise LIGHTLAYERS_UPLOAD_BYTES" in detail
        assert context.storage.list("") == []

    def test_a_large_upload_is_refused_before_anything_of_it_has_come(
        self, http: httpx.Client
    ) -> None:
        place = (http.base_url.host, http.base_url.port)
        with socket.create_connection(place, 10) as raw:
            raw.sendall(
                b"POST /jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100001\r\n"
                b"Content-Type: multipart/form-data; boundary=edge\r\n\r\n"
            )
            assert raw.recv(64).startswith(b"HTTP/1.1 413 ")

    def test_a_large_upload_of_unknown_length_is_refused(self, http: httpx.Client) -> None:
        def body() -> Iterator[bytes]:
            yield b'--edge\r\nContent-Disposition: form-data; name="flash"; filename="a"\r\n\r\n'
            for _ in range(20):
                yield b"x" * 10_000

        headers = {"content-type": "multipart/form-data; boundary=edge"}
        answer = http.post("/jobs", content=body(), headers=headers)
        assert problem_of(answer)[:2] == (413, "upload-too-large")


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/jobs/nothing"),
        ("DELETE", "/jobs/nothing"),
        ("POST", "/jobs/nothing/cancel"),
        ("GET", "/jobs/nothing/results"),
        ("GET", "/jobs/nothing/results/lamp1.jpg"),
        ("GET", "/jobs/nothing/results.zip"),
    ],
)
def test_a_job_that_is_not_there_is_a_problem(method: str, path: str, http: httpx.Client) -> None:
    status, kind, detail = problem_of(http.request(method, path))
    assert (status, kind) == (404, "unknown-job")
    assert "'nothing'" in detail


def test_a_queued_job_can_be_canceled(http: httpx.Client, context: Context) -> None:
    job = post_capture(http)
    assert len(queued(context)) == 1
    answer = http.post(job["links"]["cancel"])
    assert (answer.status_code, answer.json()["state"]) == (202, "canceled")
    assert answer.json()["links"]["cancel"] is None
    assert answer.json()["position"] is None
    assert http.post(f"/jobs/{job['id']}/cancel").json()["state"] == "canceled"
    assert queued(context) == []


def test_a_deleted_job_leaves_nothing(http: httpx.Client, png: Png, context: Context) -> None:
    job = post_pair(http, png(64, 48), png(64, 48, True)).json()
    answer = http.delete(job["links"]["self"])
    assert (answer.status_code, answer.content) == (204, b"")
    assert http.get(job["links"]["self"]).status_code == 404
    assert http.get("/jobs").json()["jobs"] == []
    assert (context.storage.list(""), queued(context)) == ([], [])


@pytest.mark.parametrize("state", ["canceled", "queued"])
def test_on_a_full_disk_files_of_a_job_that_has_ended_make_room_for_its_deletion(
    http: httpx.Client,
    png: Png,
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
    state: str,
) -> None:
    condemn = expiry.condemn

    def write(connection: sa.Connection, job_id: str) -> None:
        if context.storage.list(""):
            raise sa.exc.OperationalError("x", None, psycopg.errors.DiskFull())
        condemn(connection, job_id)

    job = post_pair(http, png(64, 48), png(64, 48, True)).json()
    if state == "canceled":
        http.post(job["links"]["cancel"])
    monkeypatch.setattr(expiry, "condemn", write)
    answer = http.delete(job["links"]["self"])
    if state == "canceled":
        assert answer.status_code == 204
        assert http.get(job["links"]["self"]).status_code == 404
    else:  # a worker may have it at any moment
        status, kind, detail = problem_of(answer)
        assert (status, kind) == (503, "database-unavailable")
        assert "delete jobs that have ended" in detail
        assert len(context.storage.list("")) == 2


def test_waiting_ends_with_its_seconds(http: httpx.Client) -> None:
    assert post_capture(http, prefer="wait=1")["state"] == "queued"
    assert post_capture(http, prefer="wait=soon")["state"] == "queued"


@pytest.mark.parametrize("path", ["/nothing", "/jobs/a/b/c/d"])
def test_unknown_paths_are_problems(path: str, http: httpx.Client) -> None:
    detail = f"GET {path}: Not Found. Check the address; /docs lists what this service answers."
    assert problem_of(http.get(path)) == (404, "http-404", detail)


@pytest.mark.parametrize(
    ("path", "allowed"),
    [("/jobs", "GET, POST"), ("/jobs/a", "GET, DELETE"), ("/uploads", "POST, OPTIONS")],
)
def test_another_method_is_answered_with_those_there_are(
    path: str, allowed: str, http: httpx.Client
) -> None:
    answer = http.put(path)
    status, kind, detail = problem_of(answer)
    assert (status, kind, answer.headers["Allow"]) == (405, "http-405", allowed)
    assert detail.startswith(f"PUT {path}: Method Not Allowed. This address takes {allowed}; ")


def test_cameras_are_listed(http: httpx.Client) -> None:
    assert [camera["address"] for camera in http.get("/cameras").json()] == ["sim://studio"]


def test_a_service_without_its_database_says_so(http: httpx.Client, context: Context) -> None:
    with context.engine.begin() as connection:
        connection.exec_driver_sql("ALTER TABLE jobs RENAME TO gone")
    answer = http.get("/jobs")
    assert problem_of(answer)[:2] == (503, "database-unavailable")
    assert "gone" not in json.dumps(answer.json())


@pytest.mark.usefixtures("cameras_in_process")
class TestConfirm:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return with_cameras(settings)

    def test_what_a_job_asks_for_is_shown_until_it_is_confirmed(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        job = capture(flash="operator").json()["jobs"][0]
        held = hold(context, job["id"])
        with context.engine.begin() as connection:
            attempts.ask_operator(connection, held, "Switch the flash off, then confirm.", 60)
        shown = http.get(f"/jobs/{job['id']}").json()
        assert shown["state"] == "waiting_for_operator"
        assert shown["operator"]["request"] == "Switch the flash off, then confirm."
        link = shown["links"]["confirm"]
        assert link == f"/jobs/{job['id']}/confirm?request=1"
        confirmed = http.post(link)
        assert (confirmed.status_code, confirmed.json()["state"]) == (202, "running")
        assert confirmed.json()["operator"] is None
        assert confirmed.json()["links"]["confirm"] is None
        status, kind, told = problem_of(http.post(link))
        assert (status, kind, told) == (
            409,
            "not-ready",
            "The job is running; it asks for nothing.",
        )

    def test_a_second_click_does_not_answer_the_next_request(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        job = capture(flash="operator").json()["jobs"][0]
        held = hold(context, job["id"])
        for request in ("off", "on"):
            with context.engine.begin() as connection:
                jobs.confirm(connection, job["id"])
                attempts.ask_operator(connection, held, f"Switch the flash {request}.", 60)
        here = f"/jobs/{job['id']}/confirm"
        assert problem_of(http.post(f"{here}?request=1"))[:2] == (409, "not-ready")
        assert http.post(here).json()["state"] == "running"

    def test_a_job_that_waits_may_be_canceled(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        job = capture(flash="operator").json()["jobs"][0]
        held = hold(context, job["id"])
        with context.engine.begin() as connection:
            attempts.ask_operator(connection, held, "Switch the flash off.", 60)
        canceling = http.post(f"/jobs/{job['id']}/cancel").json()
        assert (canceling["state"], canceling["operator"]) == ("canceling", None)
        assert problem_of(http.post(f"/jobs/{job['id']}/confirm"))[:2] == (409, "not-ready")

    def test_a_job_that_has_ended_asks_for_nothing_any_more(
        self, http: httpx.Client, capture: Any
    ) -> None:
        job = capture(flash="operator").json()["jobs"][0]
        http.post(f"/jobs/{job['id']}/cancel")
        answer = http.post(f"/jobs/{job['id']}/confirm")
        assert problem_of(answer) == (
            409,
            "ended",
            "The job is canceled; it asks for nothing any more.",
        )
        assert answer.json()["retryable"] is False

    @pytest.mark.parametrize("number", ["0", "-1", "x", "1e9", str(2**31), str(10**30)])
    def test_what_is_no_number_of_a_request_is_refused(
        self, http: httpx.Client, number: str
    ) -> None:
        assert problem_of(http.post(f"/jobs/1/confirm?request={number}"))[0] == 422

    def test_jobs_that_are_not_there_ask_for_nothing(self, http: httpx.Client) -> None:
        assert problem_of(http.post("/jobs/1/confirm"))[:2] == (404, "unknown-job")

    def test_nobody_confirms_for_another_key(self, http: httpx.Client, context: Context) -> None:
        mine, other = bearing(context, "capture"), bearing(context, "capture")
        http.get("/cameras", headers=mine)
        made = http.post(f"{PATH}/captures", json={}, headers=mine).json()["jobs"][0]
        answer = http.post(f"/jobs/{made['id']}/confirm", headers=other)
        assert problem_of(answer)[:2] == (404, "unknown-job")
