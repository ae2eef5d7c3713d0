from __future__ import annotations

import io
import json
import threading
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NoReturn

import httpx
import pytest
from obstore.exceptions import GenericError

from service.api.context import Context
from service.storage.folder import FolderStorage
from tests.unit.service.asking import post_capture, problem_of

FILES = {
    "lamp1.jpg": b"0123456789",
    "layers.exr": b"light" * 1000,
    "manifest.json": json.dumps({"lamps": []}).encode(),
}


@pytest.fixture
def job(http: httpx.Client, finish: Callable[[str, dict[str, bytes]], None]) -> str:
    """Path of a job that has succeeded."""
    made = http.post("/jobs", json={"capture": {"camera": "sim://studio"}}).json()
    finish(made["id"], FILES)
    path: str = made["links"]["self"]
    return path


def test_a_succeeded_job_links_its_results(http: httpx.Client, job: str) -> None:
    answer = http.get(job).json()
    assert (answer["state"], answer["fraction"]) == ("succeeded", 1.0)
    assert answer["links"] == {
        "self": job,
        "cancel": None,
        "confirm": None,
        "results": f"{job}/results",
        "zip": f"{job}/results.zip",
    }
    assert {file["name"]: file["size"] for file in answer["files"]} == {
        name: len(data) for name, data in FILES.items()
    }
    for file in answer["files"]:
        assert http.get(file["href"]).content == FILES[file["name"]]
    assert answer["created"] <= answer["started"] <= answer["finished"]


def test_a_store_gives_results_but_to_those_who_prefer_no_redirect(
    http: httpx.Client, context: Context, job: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(context.settings.__dict__, "store_presign", True)
    monkeypatch.setattr(FolderStorage, "link", lambda *_arguments: "http://store/lamp1.jpg")
    path = f"{job}/results/lamp1.jpg"
    answer = http.get(path, follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (307, "http://store/lamp1.jpg")
    answer = http.get(path, headers={"prefer": "no-redirect"}, follow_redirects=False)
    assert (answer.status_code, answer.content) == (200, FILES["lamp1.jpg"])


def test_the_manifest_is_json(http: httpx.Client, job: str) -> None:
    answer = http.get(f"{job}/results")
    assert answer.headers["content-type"] == "application/json"
    assert answer.json() == {"lamps": []}


def test_a_result_says_what_it_is(http: httpx.Client, job: str) -> None:
    answer = http.get(f"{job}/results/lamp1.jpg")
    assert answer.headers["content-type"] == "image/jpeg"
    assert answer.headers["content-disposition"] == 'inline; filename="lamp1.jpg"'
    assert answer.headers["content-length"] == "10"
    assert answer.headers["accept-ranges"] == "bytes"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["etag"].strip('"') == f"{10:064x}"


@pytest.mark.parametrize("what", ["results", "results/layers.exr"])
def test_what_a_result_is_can_be_asked_without_it(
    what: str, http: httpx.Client, job: str, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = http.get(f"{job}/{what}")
    monkeypatch.delattr(type(context.storage), "stream")
    head = http.head(f"{job}/{what}", headers={"range": "bytes=2-4"})
    assert (head.status_code, head.content) == (200, b"")
    for name in ("content-length", "content-type"):
        assert head.headers[name] == whole.headers[name]
    assert head.headers.get("etag") == whole.headers.get("etag")


def test_a_part_of_a_result_can_be_fetched(http: httpx.Client, job: str) -> None:
    answer = http.get(f"{job}/results/lamp1.jpg", headers={"range": "bytes=2-4"})
    assert (answer.status_code, answer.content) == (206, b"234")
    assert answer.headers["content-range"] == "bytes 2-4/10"


def test_a_download_can_go_on_only_with_the_same_file(http: httpx.Client, job: str) -> None:
    path = f"{job}/results/lamp1.jpg"
    etag = http.get(path).headers["etag"]
    same = http.get(path, headers={"range": "bytes=8-", "if-range": etag})
    assert (same.status_code, same.content) == (206, b"89")
    other = http.get(path, headers={"range": "bytes=8-", "if-range": '"other"'})
    assert (other.status_code, other.content) == (200, b"0123456789")


def test_a_range_after_the_end_is_a_problem(http: httpx.Client, job: str) -> None:
    answer = http.get(f"{job}/results/lamp1.jpg", headers={"range": "bytes=10-"})
    assert answer.status_code == 416
    assert answer.headers["content-range"] == "bytes */10"
    assert answer.json()["type"] == "urn:lightlayers:problem:range-not-satisfiable"


def test_a_file_that_is_known_is_not_sent_again(http: httpx.Client, job: str) -> None:
    path = f"{job}/results/lamp1.jpg"
    etag = http.get(path).headers["etag"]
    for known in (etag, f'"other", {etag}', "*"):
        answer = http.get(path, headers={"if-none-match": known})
        assert (answer.status_code, answer.content) == (304, b"")
        assert answer.headers["cache-control"] == "private, no-cache"
    assert http.get(path, headers={"if-none-match": '"other"'}).status_code == 200


def test_all_results_come_in_one_zip(http: httpx.Client, job: str) -> None:
    answer = http.get(f"{job}/results.zip")
    assert answer.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
        assert {name: archive.read(name) for name in archive.namelist()} == FILES


def test_the_head_of_a_zip_is_told_without_its_files(
    http: httpx.Client, job: str, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = http.get(f"{job}/results.zip")
    monkeypatch.delattr(type(context.storage), "stream")
    head = http.head(f"{job}/results.zip")
    assert (head.status_code, head.content) == (200, b"")
    apart = {"date", "trace-id"}
    assert {name: head.headers[name] for name in head.headers if name not in apart} == {
        name: whole.headers[name] for name in whole.headers if name not in apart
    }
    assert http.head(f"/jobs/{'0' * 32}/results.zip").status_code == 404


@pytest.mark.parametrize(
    "name",
    [
        "nothing.jpg",
        "LAMP1.JPG",
        "%2e%2e%2finputs%2fflash",
        "..%2f..%2f..%2flightlayers.sqlite",
        "%2fetc%2fpasswd",
        "lamp1.jpg%00",
        "lamp1.jpg%2f",
        "..%5cinputs",
    ],
)
def test_only_results_can_be_fetched(name: str, http: httpx.Client, job: str) -> None:
    answer = http.get(f"{job}/results/{name}")
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["type"].rpartition(":")[2] in ("unknown-result", "http-404")


@pytest.mark.parametrize("what", ["results", "results/lamp1.jpg", "results.zip"])
def test_a_job_that_has_not_succeeded_has_no_results(what: str, http: httpx.Client) -> None:
    made = http.post("/jobs", json={"capture": {"camera": "sim://studio"}}).json()
    answer = http.get(f"{made['links']['self']}/{what}")
    assert answer.status_code == 409
    problem = answer.json()
    assert problem["type"] == "urn:lightlayers:problem:not-ready"
    assert "queued" in problem["detail"]
    assert problem["retryable"]


@pytest.mark.parametrize("what", ["results", "results/lamp1.jpg", "results.zip", "area"])
def test_a_job_that_has_ended_without_results_is_not_asked_again(
    what: str, http: httpx.Client
) -> None:
    path = http.post("/jobs", json={"capture": {"camera": "sim://studio"}}).json()["links"]["self"]
    http.post(f"{path}/cancel")
    area = {"left": 0, "top": 0, "width": 1, "height": 1} if what == "area" else None
    answer = http.get(f"{path}/{what}", params=area)
    assert problem_of(answer) == (
        409,
        "ended",
        "The job is canceled; there will be no results, so run it again.",
    )
    assert answer.json()["retryable"] is False


@pytest.mark.parametrize("what", ["results", "results/lamp1.jpg", "results.zip"])
def test_results_that_go_at_this_moment_are_gone(
    what: str, http: httpx.Client, job: str, context: Context
) -> None:
    context.storage.delete_below(f"{job.removeprefix('/')}/")
    status, kind, detail = problem_of(http.get(f"{job}/{what}"))
    assert (status, kind) == (410, "gone")
    assert "being deleted" in detail


def test_a_zip_is_broken_off_when_its_job_is_deleted(
    http: httpx.Client,
    finish: Callable[[str, dict[str, bytes]], None],
    caplog: pytest.LogCaptureFixture,
) -> None:
    made = http.post("/jobs", json={"capture": {"camera": "sim://studio"}}).json()
    finish(made["id"], dict.fromkeys(("a", "b", "manifest.json"), bytes(20_000_000)))
    path = http.get(made["links"]["self"]).json()["links"]["zip"]
    with httpx.stream("GET", f"{http.base_url}{path}", timeout=60) as answer:
        chunks = answer.iter_raw()
        next(chunks)
        assert http.delete(made["links"]["self"]).status_code == 204
        with pytest.raises(httpx.RemoteProtocolError):  # nobody takes it for whole
            for _ in chunks:
                pass
    (told,) = [record for record in caplog.records if record.name == "service.api"]
    assert (told.getMessage(), told.exc_info) == ("answer broken off: gone", None)


@pytest.mark.parametrize("what", ["results/lamp1.jpg", "results.zip"])
def test_a_file_that_is_deleted_in_its_middle_is_broken_off(
    what: str,
    http: httpx.Client,
    job: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def cut(*_arguments: object) -> Iterator[bytes]:
        yield b"01234"
        raise FileNotFoundError  # as the next piece of a large one in S3

    monkeypatch.setattr(FolderStorage, "stream", cut)
    with pytest.raises(httpx.RemoteProtocolError):
        http.get(f"{job}/{what}")
    (told,) = [record for record in caplog.records if record.name == "service.api"]
    assert (told.getMessage(), told.exc_info) == ("answer broken off: gone", None)


@pytest.mark.parametrize("what", ["results", "results/lamp1.jpg", "results.zip", "area"])
def test_downloads_from_a_store_that_hangs_leave_threads_to_others(
    what: str, http: httpx.Client, job: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken, go_on = threading.Semaphore(0), threading.Event()

    def wait(*_arguments: object) -> NoReturn:
        taken.release()
        go_on.wait(120)
        raise GenericError("the store is away")

    for read in ("get", "stream"):
        monkeypatch.setattr(FolderStorage, read, wait)
    area = {"left": 0, "top": 0, "width": 1, "height": 1} if what == "area" else None
    with ThreadPoolExecutor(45) as pool:
        asked = [pool.submit(http.get, f"{job}/{what}", params=area) for _ in range(45)]
        try:
            for _ in range(40):  # as many as are read at a time
                assert taken.acquire(timeout=60)
            assert len(http.get("/jobs", timeout=60).json()["jobs"]) == 1
        finally:
            go_on.set()
        assert {each.result().status_code for each in asked} == {503}


def test_a_download_that_hangs_in_the_middle_leaves_threads_to_others(
    http: httpx.Client, job: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken, go_on = threading.Semaphore(0), threading.Event()

    def slowly(*_arguments: object) -> Iterator[bytes]:
        yield b"01234"
        taken.release()
        go_on.wait(120)
        yield b"56789"

    monkeypatch.setattr(FolderStorage, "stream", slowly)
    with ThreadPoolExecutor(45) as pool:
        asked = [pool.submit(http.get, f"{job}/results/lamp1.jpg") for _ in range(45)]
        try:
            for _ in range(40):
                assert taken.acquire(timeout=60)
            assert len(http.get("/jobs", timeout=60).json()["jobs"]) == 1
        finally:
            go_on.set()
        assert {each.result().content for each in asked} == {b"0123456789"}


def test_deletes_in_a_store_that_hangs_leave_threads_to_others(
    http: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = [post_capture(http)["links"]["self"] for _ in range(45)]
    taken, go_on = threading.Semaphore(0), threading.Event()

    def wait(*_arguments: object) -> None:
        taken.release()
        go_on.wait(120)

    monkeypatch.setattr(FolderStorage, "delete_below", wait)
    with ThreadPoolExecutor(45) as pool:
        asked = [pool.submit(http.delete, path) for path in paths]
        try:
            for _ in range(40):
                assert taken.acquire(timeout=60)
            assert http.get(paths[0], timeout=60).status_code == 200
        finally:
            go_on.set()
        assert {each.result().status_code for each in asked} == {204}


def test_deleting_a_job_deletes_its_results(http: httpx.Client, job: str) -> None:
    assert http.delete(job).status_code == 204
    assert http.get(f"{job}/results/lamp1.jpg").status_code == 404
