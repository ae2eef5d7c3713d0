from __future__ import annotations

import gzip
from collections.abc import Callable

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


@pytest.mark.parametrize("part", ["options", "handling"])
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "Invalid JSON: EOF while parsing a value at line 1 column 0."),
        ("{", "Invalid JSON: EOF while parsing an object at line 1 column 1."),
        ("[]", "Input should be an object."),
    ],
)
def test_a_text_of_a_form_that_cannot_be_read_is_named(
    part: str, text: str, said: str, http: httpx.Client, png: Callable[..., bytes]
) -> None:
    files = {"no_flash": png(64, 48), "flash": png(64, 48, True)}
    answer = http.post("/jobs", files=files, data={part: text})
    assert problem_of(answer) == (422, "invalid-option", f"{part}: {said}")


def test_a_fault_within_a_text_of_a_form_is_told_by_its_place(
    http: httpx.Client, png: Callable[..., bytes]
) -> None:
    files = {"no_flash": png(64, 48), "flash": png(64, 48, True)}
    for texts, said in (
        ({"options": '{"outputs": ["x"]}'}, "options: unknown output x; known are layers.exr"),
        ({"options": '{"normals": "x"}'}, "normals: Input should be 'gl' or 'dx'."),
        ({"handling": '{"priority": "x"}'}, "priority: Input should be 'high', 'normal' or 'low'."),
    ):
        assert problem_of(http.post("/jobs", files=files, data=texts))[2].startswith(said)


@pytest.mark.parametrize("path", ["/jobs", "/calibrations", "/jobs/a/mix", "/jobs/a/rerun"])
def test_a_packed_body_is_told_from_one_that_cannot_be_read(path: str, http: httpx.Client) -> None:
    headers = {"content-encoding": "GZIP", "content-type": "application/json"}
    answer = http.post(path, content=gzip.compress(b"{}"), headers=headers)
    said = "Send the body as it is, without a Content-Encoding."
    assert problem_of(answer) == (415, "unsupported-media-type", said)
    plain = http.post(path, content=b"{", headers=headers | {"content-encoding": "identity"})
    assert problem_of(plain)[:2] == (422, "invalid-option")
