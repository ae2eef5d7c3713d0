from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import httpx
import numpy as np
import pytest

from pipeline.colour.spaces import XYZ_TO_SRGB
from service.api.context import Context
from service.rows import attempts, expiry, jobs
from tests.unit.service.asking import ended_while_waiting, post_capture, problem_of
from tests.unit.service.attempts import attempt_at

Finish = Callable[[str, dict[str, bytes]], None]

EYE = np.linalg.inv(XYZ_TO_SRGB).tolist()
LAMP = {"white": [0.95, 1.0, 1.09], "neutral_to_xyz": EYE}
MANIFEST = json.dumps({"mix": {"to_xyz": EYE, "neutral": [0.95, 1.0, 1.09], "lamps": [LAMP, LAMP]}})
FILES = {"layers.exr": b"layers", "manifest.json": MANIFEST.encode()}
TWO = {"lamps": [{"ev": 1}, {"neutral": True}], "format": "tiff"}


@pytest.fixture
def separated(http: httpx.Client, finish: Finish) -> Callable[..., str]:
    """Id of a separation that has succeeded with these files."""

    def make(files: dict[str, bytes] = FILES) -> str:
        job: str = post_capture(http)["id"]
        finish(job, files)
        return job

    return make


def test_a_mix_becomes_a_queued_job(
    http: httpx.Client, separated: Callable[..., str], context: Context
) -> None:
    of = separated()

    answer = http.post(f"/jobs/{of}/mix", json={**TWO, "priority": "high"})

    assert answer.status_code == 202, answer.text
    job = answer.json()
    assert answer.headers["location"] == f"/jobs/{job['id']}" != f"/jobs/{of}"
    assert (job["state"], job["priority"], job["inputs"]) == ("queued", "high", None)
    assert job["options"] == {"kind": "mix", "of": of, "mix": TWO}
    with context.engine.connect() as connection:
        row = jobs.find(connection, job["id"])
    assert row is not None and row.task == "mix"


def test_a_mix_may_be_waited_for(
    http: httpx.Client, separated: Callable[..., str], finish: Finish
) -> None:
    path = f"/jobs/{separated()}/mix"

    mix, answer = ended_while_waiting(
        http, finish, lambda: http.post(path, json=TWO, headers={"prefer": "wait=60"})
    )

    assert (answer.status_code, answer.json()["id"]) == (202, mix)
    assert answer.json()["state"] == "succeeded"
    assert answer.headers["preference-applied"] == "wait=60"


def test_sending_twice_with_a_key_makes_one_job(
    http: httpx.Client, separated: Callable[..., str]
) -> None:
    of, key = separated(), {"Idempotency-Key": "once"}
    first, again = (http.post(f"/jobs/{of}/mix", json=TWO, headers=key).json() for _ in range(2))
    assert first["id"] == again["id"]
    other = http.post(f"/jobs/{of}/mix", json={**TWO, "format": "exr"}, headers=key)
    assert problem_of(other)[:2] == (422, "idempotency-key-reused")


def test_a_key_gives_the_mix_after_its_job_is_gone(
    http: httpx.Client, separated: Callable[..., str]
) -> None:
    of, key = separated(), {"Idempotency-Key": "once"}
    first = http.post(f"/jobs/{of}/mix", json=TWO, headers=key).json()
    http.delete(f"/jobs/{of}").raise_for_status()
    again = http.post(f"/jobs/{of}/mix", json=TWO, headers=key)
    assert (again.status_code, again.json()["id"]) == (202, first["id"])
    assert again.headers["idempotency-replayed"] == "true"
    other = http.post(f"/jobs/{of}/mix", json={**TWO, "format": "exr"}, headers=key)
    assert problem_of(other)[:2] == (422, "idempotency-key-reused")
    assert problem_of(http.post(f"/jobs/{of}/mix", json=TWO))[:2] == (404, "unknown-job")


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"lamps": [{}]}, "settings for 1 lamp, and the photograph has 2"),
        ({"lamps": []}, "lamps"),
        ({"lamps": [{}, {"ev": 11}]}, "lamp 2, ev: Input should be less than or equal to 10."),
        ({"lamps": [{}, {"gain": 1}]}, "lamp 2, gain: this name is not known."),
        (
            {"lamps": [{}, {"tint": 100}]},
            "lamp 2: a tint needs a temperature beside it, like 5000 K with a tint of 10.",
        ),
        ({"lamps": [{}, {}], "format": "gif"}, "format"),
        ([], "object"),
    ],
)
def test_settings_that_cannot_be_are_refused(
    http: httpx.Client, separated: Callable[..., str], body: Any, words: str
) -> None:
    status, kind, detail = problem_of(http.post(f"/jobs/{separated()}/mix", json=body))
    assert (status, kind) == (422, "invalid-option")
    assert words in detail


def test_jobs_without_layers_are_refused(
    http: httpx.Client, separated: Callable[..., str], context: Context
) -> None:
    unknown = http.post("/jobs/nothing/mix", json=TWO)
    assert problem_of(unknown)[:2] == (404, "unknown-job")
    early = post_capture(http)["id"]
    waiting = http.post(f"/jobs/{early}/mix", json=TWO)
    assert problem_of(waiting)[:2] == (409, "not-ready")
    http.post(f"/jobs/{early}/cancel")
    ended = http.post(f"/jobs/{early}/mix", json=TWO)
    assert problem_of(ended)[:2] == (409, "ended")
    with context.engine.begin() as connection:
        expiry.condemn(connection, early)
    expired = http.post(f"/jobs/{early}/mix", json=TWO)
    detail = "The job's results and photographs are removed; send the pair again."
    assert problem_of(expired) == (410, "gone", detail)
    bare = http.post(f"/jobs/{separated({'manifest.json': b'{}'})}/mix", json=TWO)
    assert "no layers.exr" in problem_of(bare)[2]
    old = http.post(f"/jobs/{separated({**FILES, 'manifest.json': b'{}'})}/mix", json=TWO)
    assert problem_of(old)[:2] == (422, "invalid-input")
    text = http.post(f"/jobs/{separated()}/mix", content=b"{}", headers={"content-type": "a/b"})
    assert problem_of(text)[:2] == (415, "unsupported-media-type")


def test_a_mix_whose_layers_are_deleted_fails_with_that_reason(
    http: httpx.Client, separated: Callable[..., str], context: Context
) -> None:
    of = separated()
    mix = http.post(f"/jobs/{of}/mix", json=TWO).json()
    http.delete(f"/jobs/{of}").raise_for_status()
    with context.engine.begin() as connection:
        held = attempts.claim(connection, mix["id"], "w")
    attempt_at(held, context).run()

    failed = http.get(f"/jobs/{mix['id']}").json()

    assert failed["state"] == "failed"
    assert failed["error"]["type"] == "urn:lightlayers:problem:layers-gone"
    assert failed["error"]["detail"].startswith("The job whose layers were to be mixed")
