"""The same code on PostgreSQL and an S3 store: only settings differ."""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest

import drivers


def test_a_dead_hosts_job_is_finished_by_another(
    grown_up: Any, small_pair: drivers.CapturedPair
) -> None:
    other = grown_up.start_ready_worker()
    with grown_up.held():
        jobs = [grown_up.upload(small_pair, lights=2) for _ in range(3)]
        for job in jobs[:2]:
            grown_up.await_stage(job)
        os.kill(other.pid, signal.SIGKILL)
        other.wait()
    ends = [grown_up.await_end(job) for job in jobs]
    assert [job["state"] for job in ends] == ["succeeded"] * 3
    assert sorted(job["attempt"] for job in ends) == [1, 1, 2]
    for job in ends:
        for file in job["files"]:
            answer = grown_up.http.get(file["href"], follow_redirects=True)
            assert (answer.status_code, len(answer.content)) == (200, file["size"])
    assert not (grown_up.data / "lightlayers.sqlite").exists()
    assert not (grown_up.data / "store").exists()
    first = ends[0]["links"]["self"]
    assert grown_up.http.delete(first).status_code == 204
    assert grown_up.http.get(first).status_code == 404


def test_of_requests_with_one_key_one_makes_the_job(
    grown_up: Any, small_pair: drivers.CapturedPair
) -> None:
    files = {"no_flash": small_pair.no_flash.best, "flash": small_pair.flash.best}

    def send(options: str) -> httpx.Response:
        headers = {"idempotency-key": "once"}
        answer: httpx.Response = grown_up.http.post(
            "/jobs", files=files, data={"options": options}, headers=headers
        )
        return answer

    before = _listed(grown_up)
    options = '{"lights": 2}'
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(send, [options] * 4))
    assert [answer.status_code for answer in answers] == [202] * 4
    first = answers[0].json()
    assert {answer.json()["id"] for answer in answers} == {first["id"]}
    assert _listed(grown_up) - before == {first["id"]}
    assert [answer.headers.get("idempotency-replayed") for answer in answers].count("true") == 3
    assert send('{"lights": 1}').status_code == 422
    assert grown_up.await_end(first)["state"] == "succeeded"
    assert send(options).json()["state"] == "succeeded"
    assert grown_up.http.delete(first["links"]["self"]).status_code == 204
    assert send(options).json()["id"] != first["id"]


@pytest.fixture
def hosts(
    grown_up: Any, make_service: Callable[..., Any], tmp_path: Path, s3: dict[str, str]
) -> list[Any]:
    """Two hosts of one service, of which the first one does the jobs."""
    shared = ("database_url", "store_url", "store_presign")
    settings = {name: grown_up.environment[f"LIGHTLAYERS_{name.upper()}"] for name in shared}
    second = make_service(tmp_path / "second", **settings)
    second.environment |= s3
    second.start_without_worker()
    return [grown_up, second]


def test_any_host_takes_the_next_piece_and_the_store_gives_the_results(
    hosts: list[Any], s3: dict[str, str], small_pair: drivers.CapturedPair
) -> None:
    uploads = {
        frame: _send_by_turns(hosts, data)
        for frame, data in (
            ("no_flash", small_pair.no_flash.best),
            ("flash", small_pair.flash.best),
        )
    }
    first, second = hosts
    store = first.environment["LIGHTLAYERS_STORE_URL"].removeprefix("s3://")
    # so small a picture does not tell how many lamps there are
    made = second.http.post("/jobs", json={"uploads": uploads, "options": {"lights": 2}})
    assert made.status_code == 202, made.text
    assert made.json()["inputs"]["flash"]["sha256"] == _digest(small_pair.flash.best)
    end = first.await_end(made.json())
    assert end["state"] == "succeeded"
    for file in end["files"]:
        answer = second.http.get(file["href"], follow_redirects=False)
        assert (answer.status_code, answer.headers["cache-control"]) == (307, "no-store")
        link = answer.headers["location"]
        assert link.startswith(f"{s3['AWS_ENDPOINT_URL']}/{store}/jobs/")
        assert parse_qs(urlsplit(link).query)["X-Amz-Expires"] == ["300"]
        stored = httpx.get(link, timeout=60).raise_for_status()
        assert _digest(stored.content) == file["sha256"]
        wish = {"prefer": "no-redirect"}
        answer = second.http.get(file["href"], headers=wish, follow_redirects=False)
        assert (answer.status_code, _digest(answer.content)) == (200, file["sha256"])
        for name in ("content-type", "content-disposition"):
            assert stored.headers[name] == answer.headers[name]
        asked = second.http.head(file["href"], follow_redirects=False)
        assert (asked.status_code, asked.headers["content-length"]) == (200, str(file["size"]))
    part = httpx.get(link, headers={"range": "bytes=0-3"}, timeout=60)
    assert (part.status_code, len(part.content)) == (206, 4)
    other = httpx.get(link.replace("/jobs/", "/uploads/"), timeout=60)
    assert other.status_code in (403, 404)
    known = second.http.get(file["href"], headers={"if-none-match": f'"{file["sha256"]}"'})
    assert known.status_code == 304
    manifest = first.http.get(end["links"]["results"], follow_redirects=False)
    assert manifest.status_code == 200 and len(manifest.json()["lamps"]) == 2


def _send_by_turns(hosts: list[Any], data: bytes) -> str:
    """Upload in three pieces, each to the other host; the id."""
    tus = {"tus-resumable": "1.0.0"}
    length = {"upload-length": str(len(data))}
    place = hosts[0].http.post("/uploads", headers=tus | length).headers["location"]
    ends = [0, len(data) // 3, 2 * len(data) // 3, len(data)]
    for number, (start, end) in enumerate(pairwise(ends)):
        headers = tus | {
            "upload-offset": str(start),
            "content-type": "application/offset+octet-stream",
        }
        host, other = hosts[number % 2].http, hosts[1 - number % 2].http
        assert host.patch(place, content=data[start:end], headers=headers).status_code == 204
        assert other.head(place, headers=tus).headers["upload-offset"] == str(end)
        # The other host knows that this piece has come already.
        again = other.patch(place, content=data[start:end], headers=headers)
        assert again.status_code in (409, 413)
    return str(place.rpartition("/")[2])


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _listed(service: Any) -> set[str]:
    return {job["id"] for job in service.http.get("/jobs").json()["jobs"]}
