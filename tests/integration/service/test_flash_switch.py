"""A flash on a relay is off once a job has ended, however that came about."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from tests.integration.service.real_service import Service

CAMERA = "sim://studio?width=64&height=64"


class Relay(ThreadingHTTPServer):
    """A relay that takes its time to answer that it is on."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Answer)
        self.told: list[str] = []
        self.let_go = threading.Event()
        self.order = f"http://127.0.0.1:{self.server_port}/{{state}}"


class _Answer(BaseHTTPRequestHandler):
    server: Relay

    def do_GET(self) -> None:
        self.server.told.append(self.path)
        if self.path == "/on":
            self.server.let_go.wait(60)
        self.send_response(204)
        self.end_headers()

    def log_message(self, format: str, *arguments: object) -> None:
        """Stay quiet."""


@pytest.fixture(scope="module")
def _relay() -> Iterator[Relay]:
    with Relay() as served:
        thread = threading.Thread(target=served.serve_forever)
        thread.start()
        yield served
        served.shutdown()
        thread.join()


@pytest.fixture
def relay(_relay: Relay) -> Iterator[Relay]:
    """A relay that was told nothing yet."""
    _relay.told.clear()
    _relay.let_go = threading.Event()
    yield _relay
    _relay.let_go.set()


@pytest.fixture(scope="module")
def service(_relay: Relay, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service whose flash is on the relay."""
    service = Service(
        tmp_path_factory.mktemp("service"),
        cameras=CAMERA,
        flash_switch=_relay.order,
        flash_settle_seconds=0,
        job_seconds=45,  # that a busy machine comes to the flash, and a frozen job still ends
    )
    service.start()
    yield service
    service.close()


def _cancel(service: Any, job: dict[str, Any]) -> None:
    service.http.post(f"/jobs/{job['id']}/cancel").raise_for_status()


def _freeze(service: Any, _job: dict[str, Any]) -> None:
    """Have the job run out of time."""
    for pid in service.find("child"):
        os.kill(pid, signal.SIGSTOP)


def _kill(service: Any, _job: dict[str, Any]) -> None:
    for pid in service.find("child"):
        os.kill(pid, signal.SIGKILL)


def _kill_worker_and_cancel(service: Any, job: dict[str, Any]) -> None:
    for pid in service.find("worker"):
        os.kill(pid, signal.SIGKILL)
    _cancel(service, job)


def _await_light(service: Service, relay: Relay, job: dict[str, Any]) -> None:
    """Wait until the job has told the relay that it is on, which has not answered yet."""

    def look() -> bool:
        error = service.look(job)["error"]
        assert error is None, error
        return "/on" in relay.told

    service.await_that("the relay is on", look)


@pytest.mark.parametrize(
    ("ends", "outcome"),
    [
        (_cancel, None),
        (_freeze, "timed-out"),
        (_kill, "out-of-memory"),
        (_kill_worker_and_cancel, None),
    ],
)
def test_a_flash_on_a_relay_is_off_when_its_job_has_ended(
    ends: Callable[[Any, dict[str, Any]], None],
    outcome: str | None,
    service: Service,
    relay: Relay,
) -> None:
    job = service.capture(CAMERA, flash="external")
    _await_light(service, relay, job)
    ends(service, job)
    done = service.await_end(job)
    assert relay.told == ["/off", "/on", "/off"]
    assert done["state"] == ("failed" if outcome else "canceled")
    if outcome:
        assert done["error"]["type"] == f"urn:lightlayers:problem:{outcome}"


def test_a_flash_is_off_when_a_job_is_deleted_whose_worker_has_died(
    service: Service, relay: Relay
) -> None:
    job = service.capture(CAMERA, flash="external")
    _await_light(service, relay, job)
    for pid in service.find("worker"):
        os.kill(pid, signal.SIGKILL)
    service.http.delete(f"/jobs/{job['id']}").raise_for_status()
    service.await_that("the relay is off", lambda: relay.told[-1] == "/off")
    assert relay.told == ["/off", "/on", "/off"]
