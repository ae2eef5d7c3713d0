from __future__ import annotations

import asyncio
import json
import socket
import threading
from types import SimpleNamespace
from urllib.parse import urlsplit

import httpx
import pytest
from starlette.types import Message, Receive, Scope, Send

from service.api import jobs as routes
from service.api.context import Context
from service.api.limits import Limits
from service.settings import Settings
from tests.unit.service.asking import post_capture, problem_of


def _connect(http: httpx.Client) -> socket.socket:
    address = urlsplit(str(http.base_url))
    return socket.create_connection((address.hostname, address.port), timeout=60)


@pytest.mark.parametrize("begun", [False, True])
def test_a_request_that_a_stop_cuts_off_may_be_sent_again(begun: bool, settings: Settings) -> None:
    start: Message = {"type": "http.response.start", "status": 200, "headers": []}
    sent: list[Message] = []

    async def app(_scope: Scope, _receive: Receive, send: Send) -> None:
        if begun:
            await send(start)
        await asyncio.Event().wait()

    async def receive() -> Message:
        return {"type": "http.request"}

    async def note(message: Message) -> None:
        sent.append(message)

    async def cut() -> None:
        state = SimpleNamespace(context=SimpleNamespace(settings=settings))
        scope = {"type": "http", "path": "/jobs", "app": SimpleNamespace(state=state)}
        request = asyncio.create_task(
            Limits(app)(scope | {"state": {"trace_id": "1" * 32}}, receive, note)
        )
        await asyncio.sleep(0)
        request.cancel()
        await request

    asyncio.run(cut())
    if begun:
        assert sent == [start]
        return
    assert sent[0]["status"] == 503
    problem = json.loads(sent[1]["body"])
    assert (problem["type"], problem["retryable"], problem["detail"]) == (
        "urn:lightlayers:problem:service-not-ready",
        True,
        "The service has stopped meanwhile; send it again.",
    )


class TestFewRequests:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"requests": 1})

    def test_more_requests_than_may_run_are_refused(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        inside, go_on = threading.Event(), threading.Event()

        def stay(*_arguments: object) -> bool:
            inside.set()
            return go_on.wait(60)

        monkeypatch.setattr(routes, "refuse_when_full", stay)
        waiting = threading.Thread(target=post_capture, args=(http,))
        waiting.start()
        assert inside.wait(60)
        refused = http.get("/jobs")
        assert http.get("/healthz").status_code == 200
        go_on.set()
        waiting.join()
        assert problem_of(refused)[:2] == (503, "busy")
        assert refused.json()["retryable"] and int(refused.headers["retry-after"]) > 0
        assert refused.headers["x-content-type-options"] == "nosniff"
        assert http.get("/jobs").status_code == 200


class TestShortPauses:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"pause_seconds": 0.7})

    @pytest.mark.parametrize(
        "kind", ["application/json", "multipart/form-data; boundary=x", "multipart/form-data"]
    )
    def test_a_body_that_does_not_come_ends_its_request(
        self, kind: str, http: httpx.Client, context: Context
    ) -> None:
        head = (
            f"POST /jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: {kind}\r\n"
            "Content-Length: 1000\r\n\r\n"
        )
        with _connect(http) as client:
            client.sendall(head.encode() + b"--x\r\n")
            answer = b""
            while part := client.recv(4096):
                answer += part
        assert answer.startswith((b"HTTP/1.1 408", b"HTTP/1.1 400"))
        assert b"problem:" in answer
        assert context.storage.list("") == []

    def test_who_waits_for_a_job_may_be_silent(self, http: httpx.Client) -> None:
        assert post_capture(http, prefer="wait=2")["state"] == "queued"
