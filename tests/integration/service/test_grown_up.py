"""The same code on PostgreSQL and an S3 store: only settings differ."""

from __future__ import annotations

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx

import drivers


def test_a_dead_hosts_job_is_finished_by_another(grown_up: Any, pair: drivers.CapturedPair) -> None:
    other = grown_up.start_worker()
    grown_up.await_that(
        "both workers are ready", lambda: grown_up.log.read_text().count('"message": "ready"') == 2
    )
    jobs = [grown_up.upload(pair) for _ in range(3)]
    running = [grown_up.await_stage(job) for job in jobs[:2]]
    assert all(job["attempt"] == 1 for job in running)
    os.kill(other.pid, signal.SIGKILL)
    other.wait()
    ends = [grown_up.await_end(job) for job in jobs]
    assert [job["state"] for job in ends] == ["succeeded"] * 3
    assert sorted(job["attempt"] for job in ends) == [1, 1, 2]
    for job in ends:
        for file in job["files"]:
            answer = grown_up.http.get(file["href"])
            assert (answer.status_code, len(answer.content)) == (200, file["size"])
    assert not (grown_up.data / "lightlayers.sqlite").exists()
    assert not (grown_up.data / "store").exists()
    first = ends[0]["links"]["self"]
    assert grown_up.http.delete(first).status_code == 204
    assert grown_up.http.get(first).status_code == 404


def test_of_requests_with_one_key_one_makes_the_job(
    grown_up: Any, pair: drivers.CapturedPair
) -> None:
    files = {"no_flash": pair.no_flash.best, "flash": pair.flash.best}

    def send(options: str) -> httpx.Response:
        headers = {"idempotency-key": "once"}
        answer: httpx.Response = grown_up.http.post(
            "/jobs", files=files, data={"options": options}, headers=headers
        )
        return answer

    before = _listed(grown_up)
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(send, ["{}"] * 4))
    assert [answer.status_code for answer in answers] == [202] * 4
    first = answers[0].json()
    assert {answer.json()["id"] for answer in answers} == {first["id"]}
    assert _listed(grown_up) - before == {first["id"]}
    assert [answer.headers.get("idempotency-replayed") for answer in answers].count("true") == 3
    assert send('{"lights": 1}').status_code == 422
    assert grown_up.await_end(first)["state"] == "succeeded"
    assert send("{}").json()["state"] == "succeeded"
    assert grown_up.http.delete(first["links"]["self"]).status_code == 204
    assert send("{}").json()["id"] != first["id"]


def _listed(service: Any) -> set[str]:
    return {job["id"] for job in service.http.get("/jobs").json()["jobs"]}
