"""What a job may use is limited; one that wants more fails with that reason, and hurts no other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

import drivers
from pipeline.decode import decode
from service.settings import MIB
from tests.png_bombs import png_bomb


def _send(service: Any, no_flash: bytes, flash: bytes) -> Any:
    return service.http.post("/jobs", files={"no_flash": no_flash, "flash": flash})


def test_a_job_that_takes_longer_than_it_may_fails_with_that_reason(
    tmp_path: Path, make_service: Any, small_pair: drivers.CapturedPair
) -> None:
    service = make_service(tmp_path / "service", job_seconds=1.5)
    service.start()
    workers = service.find("worker")
    with service.held():
        job = service.await_end(service.upload(small_pair, lights=2))
    assert job["attempt"] == 1
    _check_limited(service, job, workers, "timed-out", "took longer than")


def test_a_job_that_writes_more_than_it_may_fails_with_that_reason(
    tmp_path: Path, make_service: Any, pair: drivers.CapturedPair
) -> None:
    service = make_service(tmp_path / "service", job_output_bytes=MIB)
    service.start()
    workers = service.find("worker")
    job = service.await_end(service.upload(pair, lights=2))
    assert job["attempt"] == 1
    _check_limited(service, job, workers, "output-too-large", "are larger")


def test_a_job_that_wants_more_memory_than_it_may_have_fails_with_that_reason(
    tmp_path: Path, make_service: Any, pair: drivers.CapturedPair
) -> None:
    """Of 48 megapixels, which nobody has to render."""
    service = make_service(tmp_path / "service", job_memory_bytes=1024 * MIB)
    service.start()
    workers = service.find("worker")
    large = [_enlarged(frame.best) for frame in (pair.no_flash, pair.flash)]
    answer = _send(service, *large)
    assert answer.status_code == 202, answer.text
    job = service.await_end(answer.json())
    assert job["attempt"] == 1
    _check_limited(service, job, workers, "out-of-memory", "more memory")


def _enlarged(data: bytes) -> bytes:
    """A JPEG of 8000 × 6000 pixels of a photograph."""
    pixels = decode(data).pixels[:, :, ::-1]
    small = (255 * np.sqrt(np.clip(pixels / pixels.max(), 0, 1))).astype(np.uint8)
    return cv2.imencode(".jpg", cv2.resize(small, (8000, 6000)))[1].tobytes()


def _check_limited(service: Any, job: Any, workers: Any, kind: str, words: str) -> None:
    """The job failed for that reason, and its worker goes on."""
    assert job["state"] == "failed"
    assert job["error"]["type"] == f"urn:lightlayers:problem:{kind}"
    assert words in job["error"]["detail"]
    assert service.find("child") == []
    assert list((service.data / "work").iterdir()) == []
    # A camera that fails at once, or too late, tells that it takes jobs.
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
