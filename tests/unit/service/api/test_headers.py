from __future__ import annotations

import asyncio
from collections.abc import Callable

import httpx
import pytest
from fastapi import FastAPI

from service.api import create_app
from service.api.context import Context
from service.api.headers import DEFAULTS
from service.settings import Settings
from tests.unit.service.asking import post_capture

Finish = Callable[[str, dict[str, bytes]], None]
ORIGIN = "https://app.example"


@pytest.fixture
def app(context: Context) -> FastAPI:
    app = create_app([ORIGIN])
    app.state.context = context
    return app


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(update={"origins": ORIGIN})


def _asking(app: FastAPI, base_url: str = "http://localhost") -> httpx.AsyncClient:
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url=base_url)


@pytest.fixture
def broken(app: FastAPI) -> FastAPI:
    def fail() -> None:
        raise ZeroDivisionError

    app.add_api_route("/broken", fail)
    return app


@pytest.mark.parametrize("path", ["/jobs", "/healthz", "/nothing", "/jobs/1", "/openapi.json"])
def test_every_answer_has_the_defaults(path: str, http: httpx.Client) -> None:
    answer = http.get(path)
    assert {name: answer.headers.get(name) for name in DEFAULTS} == DEFAULTS
    assert "strict-transport-security" not in answer.headers


@pytest.mark.parametrize("length", [{}, {"content-length": "4"}])
def test_a_connection_ends_whose_request_may_be_seen_to_end_at_two_places(
    length: dict[str, str], http: httpx.Client
) -> None:
    headers = {"content-type": "application/json", "transfer-encoding": "chunked", **length}
    answer = http.post("/jobs", content=iter([b"{}"]), headers=headers)
    assert answer.status_code == 422
    assert answer.headers.get("connection") == ("close" if length else None)


def test_results_may_be_kept_where_the_service_is_asked_each_time(
    http: httpx.Client, finish: Finish
) -> None:
    job = post_capture(http)
    finish(job["id"], {"lamp1.jpg": b"light", "manifest.json": b"{}"})
    file = http.get(f"{job['links']['self']}/results/lamp1.jpg")
    assert file.headers["cache-control"] == "private, no-cache"
    assert file.headers["content-security-policy"] == DEFAULTS["Content-Security-Policy"]
    for path in ("", "/results", "/results.zip"):
        answer = http.get(job["links"]["self"] + path)
        assert answer.headers["cache-control"] == "no-store"
        assert answer.headers["x-content-type-options"] == "nosniff"


def test_a_fault_of_the_service_has_them_too(broken: FastAPI) -> None:
    answer = _run(broken, "GET", "/broken")
    assert answer.status_code == 500
    assert {name: answer.headers.get(name) for name in DEFAULTS} == DEFAULTS
    assert answer.headers["trace-id"] == answer.json()["trace_id"]


def test_only_https_is_made_to_last(app: FastAPI) -> None:
    answer = _run(app, "GET", "/healthz", base_url="https://localhost")
    assert answer.headers["strict-transport-security"] == "max-age=31536000"


def test_pages_of_other_sites_may_not_read(http: httpx.Client) -> None:
    asked = {"origin": "https://evil.example", "access-control-request-method": "POST"}
    for answer in (
        http.get("/healthz", headers={"origin": "https://evil.example"}),
        http.options("/jobs", headers=asked),
    ):
        assert not [name for name in answer.headers if name.startswith("access-control")]


def test_pages_that_the_operator_named_may(app: FastAPI) -> None:
    preflight = {
        "origin": ORIGIN,
        "access-control-request-method": "POST",
        "access-control-request-headers": "authorization, idempotency-key, if-range, "
        "upload-checksum, upload-offset, x-http-method-override",
    }
    allowed = _run(app, "OPTIONS", "/jobs", headers=preflight)
    assert allowed.status_code == 200
    assert allowed.headers["access-control-allow-origin"] == ORIGIN
    assert "access-control-allow-credentials" not in allowed.headers
    answer = _run(app, "GET", "/jobs", headers={"origin": ORIGIN})
    assert answer.status_code == 200
    assert answer.headers["access-control-allow-origin"] == ORIGIN
    shown = answer.headers["access-control-expose-headers"].split(", ")
    assert {"Location", "Preference-Applied", "Upload-Expires", "Upload-Offset"} <= set(shown)
    others = _run(app, "OPTIONS", "/jobs", headers={**preflight, "origin": "https://evil.example"})
    assert "access-control-allow-origin" not in others.headers


def _run(app: FastAPI, method: str, path: str, **more: object) -> httpx.Response:
    async def ask() -> httpx.Response:
        base_url = str(more.pop("base_url", "http://localhost"))
        async with _asking(app, base_url) as client:
            return await client.request(method, path, **more)  # type: ignore[arg-type]

    return asyncio.run(ask())
