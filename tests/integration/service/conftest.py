"""The service as real processes, on SQLite and a folder or on PostgreSQL and S3."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NoReturn

import httpx
import pytest
import sqlalchemy as sa
from moto.server import ThreadedMotoServer

import drivers
from service.rows import database
from tests.chaos.relay import Relay
from tests.integration.service.real_service import Service
from tests.postgresql import PostgreSQL, find_programs

SILENCE_SECONDS = 15
"""How long a worker may stand still, as on a busy machine; for tests that do not wait for it.

That a process has ended is noticed at once.
"""


@pytest.fixture(scope="package")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service that runs all the time; what a test leaves there is the next one's to bear."""
    # quick heartbeats would cost it a fiftieth of a processor all the time
    yield from _running(Service(tmp_path_factory.mktemp("service"), heartbeat_seconds=2))


@pytest.fixture(scope="module")  # few ask for it, and while it runs it costs others their time
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


@pytest.fixture(scope="module")
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
def grown_up(_grown_up: Service, store_relay: Relay) -> Iterator[Service]:
    """A service on PostgreSQL and S3, which answers for results with the store's URLs."""
    yield _grown_up
    store_relay.mend()  # a test that fails leaves it cut
    _grown_up.tidy()


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


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """URL of an empty database of either kind."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'empty.sqlite'}"
    made: str = request.getfixturevalue("make_database")()
    return made
