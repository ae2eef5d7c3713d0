"""Requests for jobs, and what is in the answers."""

from __future__ import annotations

from typing import Any

import httpx

from service import jobs
from service.api.context import Context


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


def rows_of(context: Context) -> list[jobs.Job]:
    """Every job of the database, newest first."""
    with context.engine.connect() as connection:
        return jobs.page(connection, "", 100, None)


def problem_of(answer: httpx.Response) -> tuple[int, str, str]:
    """Status, kind and sentence; checks what every problem has."""
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert set(problem) == {"type", "title", "status", "detail", "retryable", "trace_id"}
    assert problem["status"] == answer.status_code
    assert problem["trace_id"] == answer.headers["trace-id"]
    assert "\n" not in problem["detail"] and problem["detail"].endswith(".")
    return answer.status_code, problem["type"].rpartition(":")[2], problem["detail"]
