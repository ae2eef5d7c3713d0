from __future__ import annotations

import httpx
import pytest

from tests.unit.service.asking import post_capture, problem_of


@pytest.mark.parametrize("key", [b"", b"x" * 256, b"two words", b"a\tb", "Schlüssel".encode()])
def test_an_idempotency_key_that_cannot_be_is_refused(key: bytes, http: httpx.Client) -> None:
    wanted = {"capture": {"camera": "sim://studio"}}
    answer = http.post("/jobs", json=wanted, headers=[(b"idempotency-key", key)])
    status, kind, detail = problem_of(answer)
    assert (status, kind) == (422, "invalid-request")
    assert detail.startswith("header.idempotency-key: use 1 to 255 visible ASCII characters")
    assert http.get("/jobs").json()["jobs"] == []


@pytest.mark.parametrize("key", ["x" * 255, '"8e03978e-40d5-43dd-bc93-6894a57f9324"', "!~"])
def test_an_idempotency_key_may_be_any_visible_text(key: str, http: httpx.Client) -> None:
    made = [post_capture(http, **{"idempotency-key": key})["id"] for _ in range(2)]
    assert made[0] == made[1]
