"""`lightlayers serve` and what belongs to it as real processes, for tests to use and to kill."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import pytest

import drivers
from pipeline.progress import STAGES
from service.sending.client import Client
from service.sending.failures import ServiceAwayError
from tests.ports import free_port

Job = dict[str, Any]

_PATIENCE_SECONDS = 240


def await_that(what: str, happened: Callable[[], Any]) -> Any:
    """Wait until a function gives something true; what it gave."""
    deadline = time.monotonic() + _PATIENCE_SECONDS
    while time.monotonic() < deadline:
        if value := happened():
            return value
        time.sleep(0.1)  # each look costs the service a request
    pytest.fail(f"waited in vain until {what}")


class Process(NamedTuple):
    parent: int
    command: str


def family(pid: int) -> dict[int, Process]:
    """A process and all living ones below it, by process id."""
    parents: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if state not in "ZX":
            parents[int(stat.parent.name)] = int(parent)
    found = [pid]
    for number in found:
        found += [child for child, parent in parents.items() if parent == number]
    members: dict[int, Process] = {}
    for number in found:
        try:
            command = Path(f"/proc/{number}/cmdline").read_text().replace("\0", " ")
        except (FileNotFoundError, ProcessLookupError):
            continue
        members[number] = Process(parents.get(number, 0), command)
    return members


class Service:
    """`lightlayers serve` in a process of its own, with quick heartbeats."""

    def __init__(self, folder: Path, **settings: object) -> None:
        folder.mkdir(exist_ok=True)
        self.data = folder / "data"
        self.log = folder / "log"
        self.port = free_port()
        quick = {"heartbeat_seconds": 0.5, "poll_seconds": 0.4, "free_bytes": 0}
        settings = {"data_dir": self.data, "port": self.port, **quick, **settings}
        self.environment = {
            **{key: text for key, text in os.environ.items() if "LIGHTLAYERS_" not in key},
            **{f"LIGHTLAYERS_{name.upper()}": str(value) for name, value in settings.items()},
        }
        self._gate = folder / "held"
        paths = [str(Path(__file__).with_name("held")), os.environ.get("PYTHONPATH", "")]
        self.environment |= {
            "HELD_BY": str(self._gate),
            "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        }
        self.url = f"http://127.0.0.1:{self.port}"
        self.http = httpx.Client(base_url=self.url, timeout=60)
        self._process: subprocess.Popen[bytes] | None = None
        self._others: list[subprocess.Popen[bytes]] = []

    def start(self) -> None:
        self._process = self._run("serve")
        with Client(self.url) as client:
            await_that("the service answers", lambda: self._answers(client))

    def start_without_worker(self) -> None:
        self._process = self._run("serve", "--no-worker")
        await_that("the service answers", self._listens)

    def ensure_started(self) -> None:
        """Start it, unless it runs."""
        if self._process is None or self._process.poll() is not None:
            self.start()

    def _listens(self) -> bool:
        assert self.pid
        with contextlib.suppress(httpx.TransportError):
            return self.http.get("/healthz").is_success
        return False

    def make_key(self, *arguments: str) -> str:
        command = [sys.executable, "-m", "service.cli", "keys", "create", *arguments]
        made = subprocess.run(command, env=self.environment, capture_output=True, check=True)
        return made.stdout.decode().strip()

    def migrate(self) -> None:
        """Make the tables of a database that hosts share."""
        subprocess.run(
            [sys.executable, "-m", "service.cli", "migrate"], env=self.environment, check=True
        )

    def start_worker(self) -> subprocess.Popen[bytes]:
        self._others.append(self._run("worker"))
        return self._others[-1]

    def start_ready_worker(self) -> subprocess.Popen[bytes]:
        """Start another worker, and wait until it takes jobs, too."""

        def count() -> int:
            return self.log.read_text().count('"message": "ready"')

        self.await_that("its own worker is ready", count)
        before = count()
        worker = self.start_worker()
        self.await_that("the other worker is ready", lambda: count() > before)
        return worker

    def _run(self, *command: str) -> subprocess.Popen[bytes]:
        with self.log.open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "service.cli", *command], env=self.environment, stderr=log
            )

    def _answers(self, client: Client) -> bool:
        assert self.pid
        try:
            client.check_ready()
        except ServiceAwayError:
            return False
        return True

    @property
    def pid(self) -> int:
        assert self._process is not None and self._process.poll() is None, self.log.read_text()
        return self._process.pid

    def find(self, what: str) -> list[int]:
        """Process ids of the workers ("worker"), of their fork servers or of the jobs ("child")."""
        module, parents = {
            "worker": ("workers.worker", "cli"),
            "fork server": ("workers.child", "workers.worker"),
            "child": ("workers.child", "workers.child"),
        }[what]
        found = family(self.pid)
        return [
            pid
            for pid, (parent, command) in found.items()
            if f"-m service.{module} " in command
            and parent in found
            and f"-m service.{parents} " in found[parent].command
        ]

    def processes(self) -> list[int]:
        """Process ids of the service, all of them."""
        return list(family(self.pid))

    def kill(self) -> None:
        """Kill every process of the service with -9."""
        processes = self.processes()
        for pid in processes:
            os.kill(pid, signal.SIGKILL)
        assert self._process is not None
        self._process.wait()
        await_that("all are dead", lambda: not any(map(self.lives, processes)))

    @staticmethod
    def lives(pid: int) -> bool:
        """Tell whether a process has not ended yet."""
        try:
            return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
        except (FileNotFoundError, ProcessLookupError):
            return False

    def terminate(self) -> None:
        """Ask the service to stop."""
        os.kill(self.pid, signal.SIGTERM)

    def await_unready(self) -> dict[str, Any]:
        """Wait until it says that it is not ready; the problem."""

        def look() -> dict[str, Any] | None:
            answer = httpx.get(f"{self.url}/readyz", timeout=60)
            problem: dict[str, Any] = answer.json()
            return problem if answer.status_code == 503 else None

        found: dict[str, Any] = await_that("it is not ready", look)
        return found

    def stop(self) -> int:
        """Ask the service to stop, if it was not asked before; its exit code."""
        assert self._process is not None
        self._process.terminate()
        return self._process.wait(_PATIENCE_SECONDS)

    def stop_workers(self) -> None:
        """Stop those that were started beside the service."""
        for process in self._others:
            if process.poll() is None:
                process.terminate()
                process.wait(_PATIENCE_SECONDS)
        self._others.clear()

    def tidy(self) -> None:
        """Undo what a test that failed has left: frozen processes, unfinished jobs, workers."""
        for pid in self.processes():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)
        left = self.http.get("/jobs").raise_for_status().json()["jobs"]
        for job in left:
            if cancel := job["links"]["cancel"]:
                self.http.post(cancel).raise_for_status()
                self.await_end(job)
        self.stop_workers()

    def close(self) -> None:
        self.http.close()
        self.stop_workers()
        if self._process is not None and self._process.poll() is None:
            self.stop()

    def capture(
        self, camera: str, lights: int | None = None, flash: str = "property", **handling: object
    ) -> Job:
        """lights: as for `upload`."""
        wanted = {"camera": camera, "flash": flash}
        body = {"capture": wanted, "options": _options(lights), **handling}
        answer = self.http.post("/jobs", json=body)
        assert answer.status_code == 202, answer.text
        job: Job = answer.json()
        return job

    def upload(
        self, pair: drivers.CapturedPair, lights: int | None = None, **handling: object
    ) -> Job:
        """lights: how many lamps there are; to find out is most of the work of a job."""
        files = {"no_flash": pair.no_flash.best, "flash": pair.flash.best}
        data = {"handling": json.dumps(handling), "options": json.dumps(_options(lights))}
        answer = self.http.post("/jobs", files=files, data=data)
        assert answer.status_code == 202, answer.text
        job: Job = answer.json()
        return job

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Separations stay in their middle meanwhile: a few seconds may pass unseen."""
        self._gate.touch()
        try:
            yield
        finally:
            self.release()

    def release(self) -> None:
        """Let separations go on that are held."""
        self._gate.unlink(missing_ok=True)

    def look(self, job: Job) -> Job:
        now: Job = self.http.get(job["links"]["self"]).raise_for_status().json()
        return now

    def await_stage(self, job: Job, attempt: int = 1) -> Job:
        """Wait until the job, which is held, is in the middle of its separation."""

        def separating() -> Job | None:
            now = self.look(job)
            assert now["state"] in ("queued", "running"), now
            return now if now["attempt"] == attempt and now["stage"] in STAGES else None

        found: Job = await_that("the job separates", separating)
        return found

    def await_that(self, what: str, happened: Callable[[], Any]) -> None:
        """Wait until a function gives something true."""
        await_that(what, happened)

    def await_end(self, job: Job) -> Job:
        ended = ("succeeded", "failed", "canceled")

        def look() -> Job | None:
            now = self.look(job)
            return now if now["state"] in ended else None

        found: Job = await_that("the job ends", look)
        return found


def _options(lights: int | None) -> dict[str, int]:
    return {} if lights is None else {"lights": lights}
