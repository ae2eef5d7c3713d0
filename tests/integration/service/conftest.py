"""The service as real processes, on SQLite and a folder or on PostgreSQL and S3."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, NoReturn

import httpx
import pytest
import sqlalchemy as sa
from moto.server import ThreadedMotoServer

import drivers
from pipeline.progress import STAGES
from service import database
from service.client import Client, ServiceAwayError
from tests.chaos.relay import Relay
from tests.ports import free_port
from tests.postgresql import PostgreSQL, find_programs

Job = dict[str, Any]

_PATIENCE_SECONDS = 240
SILENCE_SECONDS = 15
"""How long a worker may stand still, as on a busy machine; for tests that do not wait for it.

That a process has ended is noticed at once.
"""


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
            "worker": ("worker", "cli"),
            "fork server": ("child", "worker"),
            "child": ("child", "child"),
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


@pytest.fixture(scope="package")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service that runs all the time; what a test leaves there is the next one's to bear."""
    # quick heartbeats would cost it a fiftieth of a processor all the time
    yield from _running(Service(tmp_path_factory.mktemp("service"), heartbeat_seconds=2))


@pytest.fixture(scope="package")
def _breakable(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """Tells webhooks on this machine, again at once where they do not take it."""
    service = Service(
        tmp_path_factory.mktemp("breakable"),
        silence_seconds=SILENCE_SECONDS,
        webhook_private="127.0.0.0/8",
        webhook_retry_seconds=0.05,
    )
    yield service
    service.close()


@pytest.fixture
def breakable(_breakable: Service) -> Iterator[Service]:
    """A service to be killed, which runs again for the next test; it calls webhooks at once."""
    _breakable.ensure_started()
    yield _breakable
    _breakable.stop_workers()


@pytest.fixture
def make_service() -> Iterator[Callable[..., Service]]:
    """Make a service with settings of the test's own; it is the test that starts it."""
    with contextlib.ExitStack() as stack:

        def make(folder: Path, **settings: object) -> Service:
            service = Service(folder, **settings)
            stack.callback(service.close)
            return service

        yield make


@pytest.fixture(scope="package")
def sweeping(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service whose worker runs two jobs at once and often looks for those to be removed.

    Which are those that ended a day ago.
    """
    folder = tmp_path_factory.mktemp("sweeping")
    settings = {"retention_days": 1, "sweep_seconds": 1, "worker_concurrency": 2}
    yield from _running(Service(folder, **settings))


@pytest.fixture
def keyed_service(tmp_path: Path) -> Iterator[tuple[Service, str]]:
    """A service that needs keys, and the first one."""
    service, key = _keyed(tmp_path / "service")
    for running in _running(service):
        yield running, key


@pytest.fixture(scope="module")
def keyed_queue(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Service, str]]:
    """A service that needs keys and has no worker, so that no job ends by itself; the first key."""
    service, key = _keyed(tmp_path_factory.mktemp("queue"))
    service.start_without_worker()
    yield service, key
    service.close()


@pytest.fixture(scope="module")
def silence_seconds() -> float:
    """That of services on PostgreSQL and S3."""
    return SILENCE_SECONDS


@pytest.fixture(scope="module")
def shared_database(make_database: Callable[[], str]) -> str:
    """The URL of the database that hosts share."""
    return make_database()


@pytest.fixture(scope="module")
def store_relay(s3: dict[str, str]) -> Relay:
    """The way of `grown_up` to its store, which can be cut."""
    port = httpx.URL(s3["AWS_ENDPOINT_URL"]).port
    assert port is not None
    return Relay(port)


@pytest.fixture(scope="module")
def _grown_up(
    tmp_path_factory: pytest.TempPathFactory,
    shared_database: str,
    s3: dict[str, str],
    store_relay: Relay,
    silence_seconds: float,
) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("grown_up")
    service = Service(
        folder,
        database_url=shared_database,
        store_url=f"s3://photographs/{folder.name}",
        store_presign=True,
        silence_seconds=silence_seconds,
    )
    service.environment |= s3 | {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{store_relay.port}"}
    service.migrate()
    yield from _running(service)


@pytest.fixture
def grown_up(_grown_up: Service) -> Iterator[Service]:
    """A service on PostgreSQL and S3, which answers for results with the store's URLs."""
    yield _grown_up
    _grown_up.stop_workers()


def _keyed(folder: Path) -> tuple[Service, str]:
    service = Service(folder, keys="required")
    key = service.make_key("studio", "--scopes", "submit,read,capture")
    service.http.headers["authorization"] = f"Bearer {key}"
    return service, key


def _running(service: Service) -> Iterator[Service]:
    service.start()
    yield service
    service.close()


@pytest.fixture(scope="session")
def pair() -> drivers.CapturedPair:
    """A pair that takes some seconds to separate."""
    return _taken(300, 200)


@pytest.fixture(scope="session")
def small_pair() -> drivers.CapturedPair:
    """A pair that takes no time to separate, once it is told how many lamps there are."""
    return _taken(96, 64)


def _taken(width: int, height: int) -> drivers.CapturedPair:
    with drivers.open_camera(f"sim://studio?lights=2&width={width}&height={height}") as camera:
        return drivers.capture_pair(camera)


@pytest.fixture(scope="package")
def s3() -> Iterator[dict[str, str]]:
    """An S3 server with the bucket `photographs`: the variables that lead to it."""
    server = ThreadedMotoServer(port=0)
    server.start()
    host, port = server.get_host_and_port()
    url = f"http://{host if host != '0.0.0.0' else '127.0.0.1'}:{port}"
    httpx.put(f"{url}/photographs", timeout=120).raise_for_status()
    yield {
        "AWS_ENDPOINT_URL": url,
        "AWS_ALLOW_HTTP": "true",
        "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
    }
    server.stop()


@pytest.fixture(scope="package")
def postgresql(lacking: Callable[[str], NoReturn]) -> Iterator[str]:
    """A PostgreSQL server of its own: the URL of an empty database."""
    programs = find_programs()
    if programs is None:
        lacking("postgresql")
    # not under pytest's folder, which another run on this machine closes to the server's user
    with TemporaryDirectory(prefix="lightlayers-postgresql-") as folder:
        server = PostgreSQL(Path(folder) / "server", programs)
        server.create()
        yield server.url()
        server.stop()


@pytest.fixture(scope="package")
def make_database(postgresql: str) -> Iterator[Callable[[], str]]:
    """Make an empty database on that server; its URL."""
    root = database.connect(postgresql).execution_options(isolation_level="AUTOCOMMIT")
    numbers = itertools.count()

    def make() -> str:
        name = f"made{next(numbers)}"
        with root.connect() as connection:
            connection.exec_driver_sql(f"CREATE DATABASE {name}")
        return sa.make_url(postgresql).set(database=name).render_as_string()

    yield make
    root.dispose()
