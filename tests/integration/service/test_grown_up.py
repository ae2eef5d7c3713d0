"""The same code on PostgreSQL and an S3 store: only settings differ."""

from __future__ import annotations

import os
import signal
from typing import Any

import drivers


def test_a_dead_hosts_job_is_finished_by_another(grown_up: Any, pair: drivers.CapturedPair) -> None:
    other = grown_up.start_worker()
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
