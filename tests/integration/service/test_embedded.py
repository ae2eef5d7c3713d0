"""The embedded default: one command, SQLite and a folder."""

from __future__ import annotations

import hashlib
import io
import json
import os
import signal
import sqlite3
import zipfile
from pathlib import Path
from typing import Any

import pytest

import drivers
from service.cli import run
from service.object_keys import DATABASE_ID
from service.storage.by_url import storage_at

SMALL = "sim://studio?lights=2&width=96&height=64"


def _stored(service: Any) -> list[str]:
    return storage_at((service.data / "store").as_uri()).list("")


def _scratch(service: Any) -> list[Path]:
    return list((service.data / "work").iterdir())


def test_a_pair_goes_in_and_layers_come_out(service: Any, small_pair: drivers.CapturedPair) -> None:
    files = {
        "no_flash": ("holiday1.dng", small_pair.no_flash.best),
        "flash": ("holiday2.dng", small_pair.flash.best),
    }
    wish = {"prefer": "wait=60"}
    data = {"options": '{"lights": 2}'}
    job = service.http.post("/jobs", files=files, data=data, headers=wish, timeout=180).json()
    job = service.await_end(job)
    assert (job["state"], job["attempt"], job["error"]) == ("succeeded", 1, None)
    manifest = service.http.get(job["links"]["results"]).json()
    listed = {file["name"]: file["sha256"] for file in manifest["files"]}
    assert set(listed) | {"manifest.json"} == {file["name"] for file in job["files"]}
    assert {"layers.exr", "lamp1.jpg", "lamp2.tif"} <= set(listed)
    archive = zipfile.ZipFile(io.BytesIO(service.http.get(job["links"]["zip"]).content))
    for file in job["files"]:
        data = service.http.get(file["href"]).content
        digest = hashlib.sha256(data).hexdigest()
        assert digest == file["sha256"] == listed.get(file["name"], digest)
        assert archive.read(file["name"]) == data
    assert _scratch(service) == []
    # What the log says of the job, and what it never says.
    log = service.log.read_text()
    told = [json.loads(line)["message"] for line in log.splitlines() if job["id"] in line]
    assert told == ["started", "succeeded"]
    assert "holiday" not in log


def test_everything_killed_in_mid_job_is_finished_after_a_start(breakable: Any) -> None:
    with breakable.held():
        first = breakable.capture(SMALL, lights=2)
        breakable.await_stage(first, attempt=2)  # the first one took the pair
        second = breakable.capture(SMALL, lights=2)
        inputs = f"{first['id']}/inputs/"
        taken = {key: _digest(breakable, key) for key in _stored(breakable) if inputs in key}
        assert len(taken) == 2
        breakable.kill()
    assert _scratch(breakable)
    breakable.start()
    done = breakable.await_end(first)
    assert (done["state"], done["attempt"]) == ("succeeded", 3)
    assert breakable.await_end(second)["state"] == "succeeded"
    # The photographs were not taken again, and nothing of the first attempt is left.
    of_first = [key for key in _stored(breakable) if first["id"] in key]
    assert {key: _digest(breakable, key) for key in of_first if "/inputs/" in key} == taken
    assert {key.split("/")[2] for key in of_first} == {"inputs", "3"}
    assert _scratch(breakable) == []


def _digest(service: Any, key: str) -> str:
    data = storage_at((service.data / "store").as_uri()).get(key)
    return hashlib.sha256(data).hexdigest()


def test_a_running_job_can_be_canceled(service: Any, small_pair: drivers.CapturedPair) -> None:
    with service.held():
        job = service.upload(small_pair, lights=2)
        service.await_stage(job)
        assert len(service.find("child")) == 1
        asked = service.http.post(job["links"]["cancel"])
        assert (asked.status_code, asked.json()["state"]) == (202, "canceling")
        done = service.await_end(job)
    assert (done["state"], done["files"], done["error"]) == ("canceled", [], None)
    assert service.find("child") == []
    assert [key for key in _stored(service) if job["id"] in key] == [
        f"jobs/{job['id']}/inputs/flash",
        f"jobs/{job['id']}/inputs/no_flash",
    ]


def test_a_running_job_can_be_deleted(service: Any, small_pair: drivers.CapturedPair) -> None:
    with service.held():
        job = service.upload(small_pair, lights=2)
        service.await_stage(job)
        assert service.http.delete(job["links"]["self"]).status_code == 204
        assert service.http.get(job["links"]["self"]).status_code == 404
        service.await_that("its process is gone", lambda: not service.find("child"))
    service.await_that("nothing is stored", lambda: job["id"] not in " ".join(_stored(service)))


def test_a_crash_hurts_only_its_job(service: Any, small_pair: drivers.CapturedPair) -> None:
    with service.held():
        job = service.upload(small_pair, lights=2)
        service.await_stage(job)
        workers, servers = service.find("worker"), service.find("fork server")
        (child,) = service.find("child")
        os.kill(child, signal.SIGSEGV)
    done = service.await_end(job)
    assert done["state"] == "failed"
    assert done["error"]["type"] == "urn:lightlayers:problem:crashed"
    assert "SIGSEGV" in done["error"]["detail"]
    assert service.find("worker") == workers
    assert service.find("fork server") == servers
    assert service.await_end(service.upload(small_pair, lights=2))["state"] == "succeeded"


def test_a_dead_fork_server_costs_an_attempt(
    service: Any, small_pair: drivers.CapturedPair
) -> None:
    with service.held():
        job = service.upload(small_pair, lights=2)
        service.await_stage(job)
        workers = service.find("worker")
        (server,) = service.find("fork server")
        os.kill(server, signal.SIGKILL)
    done = service.await_end(job)
    assert (done["state"], done["attempt"]) == ("succeeded", 2)
    assert service.find("child") == []
    assert service.find("worker") == workers
    assert server not in service.find("fork server")


def test_a_killed_worker_takes_its_processes_with_it(
    breakable: Any, small_pair: drivers.CapturedPair
) -> None:
    with breakable.held():
        job = breakable.upload(small_pair, lights=2)
        breakable.await_stage(job)
        (worker,) = breakable.find("worker")
        left = [*breakable.find("fork server"), *breakable.find("child")]
        assert len(left) == 2
        os.kill(worker, signal.SIGKILL)
        breakable.await_that("they are gone", lambda: not any(map(breakable.lives, left)))
    assert breakable.await_end(job)["state"] == "succeeded"


def test_a_stopped_service_puts_its_job_back(
    breakable: Any, small_pair: drivers.CapturedPair
) -> None:
    with breakable.held():
        job = breakable.upload(small_pair, lights=2)
        breakable.await_stage(job)
        processes = breakable.processes()
        assert breakable.stop() == 0
    breakable.await_that("all are gone", lambda: not any(map(breakable.lives, processes)))
    with sqlite3.connect(breakable.data / "lightlayers.sqlite") as database:
        row = database.execute(
            "SELECT state, attempt, lost, worker FROM jobs WHERE id = ?", (job["id"],)
        ).fetchone()
    database.close()
    assert row == ("queued", 1, 0, None)
    assert _scratch(breakable) == []
    breakable.start()
    done = breakable.await_end(job)
    assert (done["state"], done["attempt"]) == ("succeeded", 2)


def test_a_job_that_kills_its_workers_is_given_up(
    breakable: Any, small_pair: drivers.CapturedPair
) -> None:
    killed: set[int] = set()
    with breakable.held():
        job = breakable.upload(small_pair, lights=2)
        for attempt in (1, 2, 3):
            breakable.await_stage(job, attempt)
            (worker,) = breakable.find("worker")
            assert worker not in killed
            os.kill(worker, signal.SIGKILL)
            killed.add(worker)
        done = breakable.await_end(job)
    assert done["state"] == "failed"
    assert done["error"]["type"] == "urn:lightlayers:problem:abandoned"
    assert "3 times" in done["error"]["detail"]


def test_a_job_past_its_deadline_fails_running_or_waiting(
    service: Any, small_pair: drivers.CapturedPair
) -> None:
    with service.held():
        running = service.upload(small_pair, lights=2)
        service.await_stage(running)
        done = service.await_end(service.upload(small_pair, deadline_seconds=0.1))
        assert (done["state"], done["attempt"]) == ("failed", 0)
        assert done["error"]["type"] == "urn:lightlayers:problem:deadline-passed"
        service.http.post(running["links"]["cancel"])
        done = service.await_end(service.upload(small_pair, lights=2, deadline_seconds=3))
    assert (done["state"], done["files"]) == ("failed", [])
    assert done["error"]["type"] == "urn:lightlayers:problem:deadline-passed"
    service.await_that("its process is gone", lambda: not service.find("child"))


def test_a_job_is_run_again_after_its_first_run_is_deleted(
    service: Any, small_pair: drivers.CapturedPair
) -> None:
    first = service.await_end(service.upload(small_pair, lights=2))
    body = {"options": {"lights": 1}, "priority": "high"}
    again = service.http.post(f"{first['links']['self']}/rerun", json=body)
    assert again.status_code == 202
    assert service.http.delete(first["links"]["self"]).status_code == 204
    done = service.await_end(again.json())
    assert (done["state"], done["options"]) == ("succeeded", {"lights": 1})
    manifest = service.http.get(done["links"]["results"]).json()
    assert manifest["lights"]["requested"] == 1


def test_jobs_are_removed_once_their_time_is_over(
    sweeping: Any, small_pair: drivers.CapturedPair
) -> None:
    job = sweeping.upload(small_pair, lights=2)
    assert sweeping.await_end(job)["expires"] is not None
    with sqlite3.connect(sweeping.data / "lightlayers.sqlite", timeout=60) as database:
        database.execute("UPDATE jobs SET expires = 1")
    database.close()
    here = job["links"]["self"]
    sweeping.await_that("it is removed", lambda: sweeping.http.get(here).status_code == 404)
    sweeping.await_that(
        "only whose store it is is stored", lambda: _stored(sweeping) == [DATABASE_ID]
    )


def test_two_workers_do_each_job_once(breakable: Any, small_pair: drivers.CapturedPair) -> None:
    breakable.start_worker()
    with breakable.held():
        jobs = [breakable.upload(small_pair, lights=2) for _ in range(2)]
        for job in jobs:  # at once, so that each worker has one
            breakable.await_stage(job)
    ends = [breakable.await_end(job) for job in jobs]
    assert [(job["state"], job["attempt"]) for job in ends] == [("succeeded", 1)] * 2


def test_one_of_two_jobs_at_once_is_canceled_alone(
    sweeping: Any, small_pair: drivers.CapturedPair
) -> None:
    with sweeping.held():
        first, second = [sweeping.upload(small_pair, lights=2) for _ in range(2)]
        for job in (first, second):
            sweeping.await_stage(job)
        assert sweeping.http.post(first["links"]["cancel"]).status_code == 202
        assert sweeping.await_end(first)["state"] == "canceled"
    done = sweeping.await_end(second)
    assert (done["state"], done["attempt"]) == ("succeeded", 1)
    assert sweeping.find("child") == []


def test_a_camera_that_fails_fails_the_job(service: Any) -> None:
    job = service.await_end(service.capture("sim://studio?fault=store_full"))
    assert job["state"] == "failed"
    assert job["error"]["type"] == "urn:lightlayers:problem:camera-failed"
    assert job["error"]["detail"].endswith(".")


def test_a_pair_is_submitted_from_the_shell(
    service: Any,
    small_pair: drivers.CapturedPair,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    paths = [tmp_path / "a.dng", tmp_path / "b.dng"]
    paths[0].write_bytes(small_pair.no_flash.best)
    paths[1].write_bytes(small_pair.flash.best)
    out = tmp_path / "out"
    command = ["submit", *map(str, paths), "-o", str(out), "--url", service.url, "--json"]
    assert run([*command, "--lights", "2"]) == 0
    said = capsys.readouterr()
    manifest = json.loads(said.out)
    assert manifest == json.loads((out / "manifest.json").read_bytes())
    assert manifest["lights"]["requested"] == 2
    names = [file["name"] for file in manifest["files"]]
    assert sorted(path.name for path in out.iterdir()) == sorted([*names, "manifest.json"])


def test_a_pair_that_is_none_is_refused_at_the_shell(
    service: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    diary = tmp_path / "diary.txt"
    diary.write_text("dear diary")
    out = tmp_path / "out"
    assert run(["submit", str(diary), str(diary), "-o", str(out), "--url", service.url]) == 2
    assert "without the flash" in capsys.readouterr().err
    assert not out.exists()
