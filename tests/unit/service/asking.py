"""Requests for jobs, and what is in the answers."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import sqlalchemy as sa

from service.api.context import Context
from service.frames import FRAMES
from service.object_keys import describe_inputs, inputs_key
from service.rows import jobs, keys


def post_pair(http: httpx.Client, no_flash: bytes, flash: bytes, **more: Any) -> httpx.Response:
    """Send a pair; more: what httpx takes."""
    files = {"no_flash": ("a.png", no_flash), "flash": ("b.png", flash)}
    return http.post("/jobs", files=files, **more)


def post_capture(http: httpx.Client, **headers: str) -> dict[str, Any]:
    """Have the simulated camera take a pair; the job."""
    answer = http.post("/jobs", json={"capture": {"camera": "sim://studio"}}, headers=headers)
    assert answer.status_code == 202
    job: dict[str, Any] = answer.json()
    return job


def stored_job(context: Context, **values: Any) -> str:
    """Queue a job of two stored photographs, as an upload does but unchecked; its id."""
    job_id = uuid.uuid4().hex
    for frame in FRAMES:
        context.storage.put(inputs_key(job_id, frame), frame.encode())
    inputs = describe_inputs(job_id, {frame: f"{len(frame):064x}" for frame in FRAMES})
    row = {"id": job_id, "options": {}, "inputs": inputs, "trace_id": "1" * 32, "request_hash": ""}
    with context.engine.begin() as connection:
        context.queue.submit(connection, job_id, jobs.add(connection, row | values))
    return job_id


def stored(engine: sa.Engine, job_id: str) -> jobs.Job:
    """A job as the database has it."""
    with engine.connect() as connection:
        job = jobs.find(connection, job_id)
    assert job is not None
    return job


def rows_of(context: Context) -> list[jobs.Job]:
    """Every job of the database, newest first."""
    with context.engine.connect() as connection:
        return jobs.page(connection, "", 100, None)


def queued(context: Context) -> list[str]:
    """Ids of what waits in the queues."""
    with context.engine.connect() as connection:
        found = connection.exec_driver_sql(
            "SELECT workflow_uuid FROM workflow_status WHERE status = 'ENQUEUED'"
        )
        return list(found.scalars())


def problem_of(answer: httpx.Response) -> tuple[int, str, str]:
    """Status, kind and sentence; checks what every problem has."""
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert set(problem) == {"type", "title", "status", "detail", "retryable", "trace_id"}
    assert problem["status"] == answer.status_code
    assert problem["trace_id"] == answer.headers["trace-id"]
    assert "\n" not in problem["detail"] and problem["detail"].endswith(".")
    return answer.status_code, problem["type"].rpartition(":")[2], problem["detail"]


def bearing(context: Context, *scopes: str, **quotas: int) -> dict[str, str]:
    """Make a key; the header that bears it."""
    with context.engine.begin() as connection:
        text = keys.create(
            connection, "a test", set(map(keys.Scope, scopes)), keys.Quotas(**quotas), None
        )
    return {"authorization": f"Bearer {text}"}


def owner_of(header: dict[str, str]) -> str:
    """Id of the key in a header."""
    return keys.id_of(header["authorization"].removeprefix("Bearer "))


def ended_while_waiting(
    http: httpx.Client,
    finish: Callable[[str, dict[str, bytes]], None],
    make: Callable[[], httpx.Response],
) -> tuple[str, httpx.Response]:
    """End the one job that a request makes while it waits: its id, and the request's answer."""
    before = {job["id"] for job in http.get("/jobs").json()["jobs"]}
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(make)
        while not (new := {job["id"] for job in http.get("/jobs").json()["jobs"]} - before):
            threading.Event().wait(0.01)
        (made,) = new
        finish(made, {})
        return made, waiting.result()
