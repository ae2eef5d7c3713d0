"""What a job may use is limited; one that wants more fails with that reason, and hurts no other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from service.settings import MIB
from tests.png_bombs import png_bomb


def _send(service: Any, no_flash: bytes, flash: bytes) -> Any:
    return service.http.post("/jobs", files={"no_flash": no_flash, "flash": flash})


@pytest.mark.parametrize(
    ("settings", "size", "kind", "words"),
    [
        (
            {"job_memory_bytes": 1024 * MIB},
            "width=4000&height=3000",
            "out-of-memory",
            "more memory",
        ),
        ({"job_seconds": 5}, "width=4000&height=3000", "timed-out", "took longer than"),
        ({"job_output_bytes": 16 * MIB}, "width=900&height=600", "output-too-large", "are larger"),
    ],
)
def test_a_job_that_wants_more_than_it_may_have_fails_with_that_reason(
    tmp_path: Path,
    make_service: Any,
    settings: dict[str, Any],
    size: str,
    kind: str,
    words: str,
) -> None:
    service = make_service(tmp_path / "service", **settings)
    service.start()
    workers = service.find("worker")
    job = service.await_end(service.capture(f"sim://studio?lights=2&{size}"))
    assert job["state"] == "failed"
    assert job["attempt"] <= 2  # the first one is the capture; none follows the one that failed
    assert job["error"]["type"] == f"urn:lightlayers:problem:{kind}"
    assert words in job["error"]["detail"]
    assert service.find("child") == []
    assert list((service.data / "work").iterdir()) == []
    # The worker goes on: a camera that fails at once, or too late, tells that it takes jobs.
    next_job = service.await_end(service.capture("sim://studio?fault=store_full"))
    kinds = {f"urn:lightlayers:problem:{each}" for each in ("camera-failed", kind)}
    assert next_job["error"]["type"] in kinds
    assert service.find("worker") == workers


def test_a_bomb_is_defused(service: Any) -> None:
    """Few bytes that would be gigabytes of pixels."""
    bomb = png_bomb(60_000, 20_000)
    assert len(bomb) < 5 * MIB
    workers = service.find("worker")
    answer = _send(service, bomb, bomb)
    assert answer.status_code == 413, answer.text
    assert answer.json()["type"] == "urn:lightlayers:problem:image-too-large"
    assert service.find("worker") == workers
    assert service.http.get("/healthz").status_code == 200
