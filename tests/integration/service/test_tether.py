"""The capture agent, a camera and a service as processes, with kills and cuts in between."""

from __future__ import annotations

import contextlib
import json
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.chaos.relay import Relay
from tests.integration.service.real_service import Service

_KILLS = 4


@pytest.fixture(scope="module")
def simcam() -> Iterator[str]:
    """A camera on the network, in a process of its own; its address."""
    command = [sys.executable, "-m", "service.cli", "simcam", "--port", "0"]
    with subprocess.Popen(
        [*command, "sim://studio?width=200&height=140&format=jpeg"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
        process.kill()


@pytest.fixture(scope="module")
def receiving(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service that takes jobs and has nobody to do them: all that an agent needs of it."""
    service = Service(tmp_path_factory.mktemp("service"))
    service.start_without_worker()
    yield service
    service.close()


@pytest.fixture
def agent(receiving: Any, simcam: str, tmp_path: Path) -> Iterator[Agent]:
    """An agent, not started yet, behind a relay."""
    relay = Relay(receiving.port)
    agent = Agent(relay, simcam, tmp_path / "spool")
    yield agent
    agent.kill()


class Agent:
    """`lightlayers tether` in a process of its own. events: what it told, of all of its lives."""

    def __init__(self, relay: Relay, camera: str, spool: Path) -> None:
        self.relay = relay
        where = [
            "--server",
            f"http://127.0.0.1:{relay.port}",
            "--camera",
            camera,
            "--spool",
            str(spool),
            "--json",
        ]
        self._command = [sys.executable, "-m", "service.cli", "tether", *where]
        self._process: subprocess.Popen[str] | None = None
        self.events: list[dict[str, Any]] = []

    def start(self, *arguments: str) -> None:
        self._process = subprocess.Popen(
            [*self._command, *arguments], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True
        )

    def await_events(self, name: str, count: int) -> None:
        """Read on until so many more of them were told."""
        while count:
            count -= self._read()["event"] == name

    def _read(self) -> dict[str, Any]:
        assert self._process is not None and self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, "the agent has ended"
        event: dict[str, Any] = json.loads(line)
        self.events.append(event)
        return event

    def kill(self) -> None:
        """Kill it with -9, if it lives; what it had told before is still read."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._take(self._process.communicate()[0])

    def await_end(self) -> int:
        assert self._process is not None
        self._take(self._process.communicate("", timeout=120)[0])
        return self._process.returncode

    def _take(self, text: str) -> None:
        for line in text.splitlines():
            with contextlib.suppress(ValueError):  # it was killed in the middle of a line
                self.events.append(json.loads(line))

    def told(self, name: str) -> list[dict[str, Any]]:
        return [event for event in self.events if event["event"] == name]


def take_jobs(service: Any) -> list[dict[str, Any]]:
    """Every job, the oldest first; they are deleted."""
    found: list[dict[str, Any]] = service.http.get("/jobs", params={"limit": 200}).json()["jobs"]
    for job in found:
        service.http.delete(job["links"]["self"]).raise_for_status()
    return found[::-1]


def test_killed_and_cut_off_at_random_it_loses_and_doubles_nothing(
    receiving: Any, agent: Agent, tmp_path: Path
) -> None:
    chance = random.Random(7)
    relay = agent.relay
    for turn in range(_KILLS):
        agent.start("--interval", "0")
        if turn % 2:
            relay.cut_after(chance.randrange(100_000))
        agent.await_events(
            chance.choice(("spooled", "spooled", "sent")) if not turn % 2 else "spooled",
            chance.randint(1, 2),
        )
        with contextlib.suppress(subprocess.TimeoutExpired):
            assert agent._process is not None
            agent._process.wait(chance.random() / 2)  # somewhere in what it does then
        agent.kill()
        relay.mend()
    receiving.kill()
    agent.start("--interval", "0", "--pairs", "1")  # the spool may be empty by now
    agent.await_events("held", 1)
    receiving.start_without_worker()
    assert agent.await_end() == 0
    jobs = take_jobs(receiving)
    arrived = [{frame: file["sha256"] for frame, file in job["inputs"].items()} for job in jobs]
    spooled = [event["sha256"] for event in agent.told("spooled")]
    assert len(spooled) >= _KILLS
    assert all(pair in arrived for pair in spooled)  # none lost
    assert all(arrived.count(pair) == 1 for pair in arrived)  # none doubled
    assert [pair for pair in arrived if pair in spooled] == spooled  # in order
    assert len(arrived) <= len(spooled) + _KILLS  # and those that it was killed before telling of
    assert agent.told("aside") == []
    left = [path for path in (tmp_path / "spool").rglob("*") if path.is_file()]
    assert [path.name for path in left] == ["lock"]


def test_the_network_goes_while_pairs_are_taken_and_comes_back(
    receiving: Any, agent: Agent
) -> None:
    agent.relay.cut()
    agent.start("--interval", "0", "--pairs", "4")
    agent.await_events("spooled", 4)
    assert take_jobs(receiving) == []
    assert len(agent.told("held")) == 1
    agent.relay.mend()
    assert agent.await_end() == 0
    shots = [event["shot"] for event in agent.told("spooled")]
    assert [event["shot"] for event in agent.told("sent")] == shots
    assert [event["job"] for event in agent.told("sent")] == [
        job["id"] for job in take_jobs(receiving)
    ]


def test_a_camera_that_announces_itself_is_listed_by_the_command(simcam: str) -> None:
    command = [sys.executable, "-m", "service.cli", "cameras", "--json"]
    deadline = time.monotonic() + 120
    found: dict[str, str] = {}
    while simcam not in found and time.monotonic() < deadline:  # words get lost on the way
        listed = subprocess.run(command, capture_output=True, text=True, check=True)
        found = {each["address"]: each["model"] for each in json.loads(listed.stdout)}
    assert found[simcam].startswith("NIKON D5100 simulated on ")
