"""The same over HTTP, with a real service: good pairs give results, bad ones a reason."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

SECONDS = 240
pytestmark = pytest.mark.timeout(SECONDS + 180)
PROBLEM = {"type", "title", "status", "detail", "retryable", "trace_id"}


def send(service: httpx.Client, pair: tuple[Path, Path], **options: object) -> httpx.Response:
    """Post a pair with its options."""
    files = {
        "no_flash": ("no_flash", pair[0].read_bytes()),
        "flash": ("flash", pair[1].read_bytes()),
    }
    return service.post("/jobs", files=files, data={"options": json.dumps(options)})


def finished(service: httpx.Client, answer: httpx.Response) -> dict[str, Any]:
    """The job of an answer once it has ended."""
    assert answer.status_code == 202, answer.text
    deadline = time.monotonic() + SECONDS
    while time.monotonic() < deadline:
        job: dict[str, Any] = service.get(answer.headers["location"]).json()
        if job["state"] in ("succeeded", "failed", "canceled"):
            return job
        time.sleep(0.2)
    pytest.fail("the job did not end")


def test_a_pair_gives_what_the_command_line_gives(
    service: httpx.Client, scene: Callable[..., Any], separated: Callable[..., Any]
) -> None:
    """To the byte, so everything that is known of those results holds for these."""
    pair = scene(2).dng
    job = finished(service, send(service, pair, outputs="all"))
    assert (job["state"], job["error"]) == ("succeeded", None)

    local = separated(pair, "--outputs", "all")

    assert service.get(f"/jobs/{job['id']}/results").json() == local.manifest
    assert {file["name"] for file in job["files"]} == local.files
    for name in local.files:
        answer = service.get(f"/jobs/{job['id']}/results/{name}")
        assert answer.content == (local.folder / name).read_bytes(), name


def test_warnings_have_codes_and_figures(service: httpx.Client, scene: Callable[..., Any]) -> None:
    job = finished(service, send(service, scene(2).jpeg, lights=1))

    warnings = service.get(f"/jobs/{job['id']}/results").json()["warnings"]
    told = {one["code"]: one["figures"] for one in warnings}
    assert told["rendered_srgb"] == {}
    assert told["unexplained"]["left_over"] > 0.08
    assert all(one["message"].endswith(".") for one in warnings)


def test_a_camera_takes_the_pair_itself(
    service: httpx.Client, scene: Callable[..., Any], separated: Callable[..., Any]
) -> None:
    """The simulated camera takes the same photographs for the service as for this test."""
    capture = {"camera": "sim://studio?lights=2&width=360&height=240&format=both"}

    job = finished(service, service.post("/jobs", json={"capture": capture}))

    assert job["state"] == "succeeded"
    manifest = service.get(f"/jobs/{job['id']}/results").json()
    assert manifest["lamps"] == separated(scene(2).dng, "--outputs", "all").manifest["lamps"]


def test_a_bad_pair_is_refused_with_the_reason(service: httpx.Client, bad_pair: Any) -> None:
    """At once, or by a job that fails, with the sentence that the command line says."""
    answer = send(service, bad_pair.files)

    if answer.status_code == 202:
        job = finished(service, answer)
        assert job["state"] == "failed"
        problem = job["error"]
    else:
        assert answer.headers["content-type"] == "application/problem+json"
        problem = answer.json()
        assert problem["status"] == answer.status_code
    assert set(problem) >= PROBLEM
    assert 400 <= problem["status"] < 500
    assert problem["retryable"] is False
    assert bad_pair.reason in problem["detail"]
    assert problem["detail"].endswith(".")
    assert "\n" not in problem["detail"]
    assert "Traceback" not in problem["detail"]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"lights": 4}, "more than three lamps"),
        ({"camera": "Nikon D5200"}, "near names are Nikon D5100"),
        ({"neutral": "D9"}, "neutral: No neutral light spectrum is called 'D9'"),
        ({"flash_spectrum": "xenonn"}, "near names are xenon"),
        ({"outputs": ["movie.mp4"]}, "movie.mp4"),
        ({"sharpen": True}, "sharpen"),
    ],
)
def test_bad_options_are_refused_at_once_with_the_reason(
    service: httpx.Client, scene: Callable[..., Any], options: dict[str, Any], word: str
) -> None:
    answer = send(service, scene(2).dng, **options)

    assert answer.status_code == 422
    assert word in answer.json()["detail"]


def test_the_service_lives_on_after_bad_input(service: httpx.Client) -> None:
    assert service.get("/healthz").status_code == 200
    assert service.get("/readyz").status_code == 200
