from __future__ import annotations

import contextlib
import io
import logging
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import httpx
import numpy as np
import pytest
import sqlalchemy as sa
import uvicorn
from fastapi import FastAPI
from PIL import Image

from service import migrations
from service.api import create_app
from service.api.context import Context, open_context
from service.dbos_queue import queue
from service.media import media_type
from service.object_keys import results_key
from service.rows import attempts, database
from service.sending.client import Client
from service.settings import Settings
from service.storage.base import Storage
from service.storage.by_url import storage_at
from service.workers import sandbox
from service.workers.forkserver import ForkServer
from tests.unit.service.contract import check_described, described
from tests.unit.service.studio import PATH, ask_in_process


@pytest.fixture(autouse=True)
def _no_settings_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in Settings.model_fields:
        monkeypatch.delenv(f"LIGHTLAYERS_{name.upper()}", raising=False)


@pytest.fixture(autouse=True)
def _logging_as_it_was() -> Iterator[None]:
    """What one test sets is not there for the next, which may look at what is logged."""
    loggers = [logging.getLogger(name) for name in (None, "service")]
    before = [(logger.level, logger.handlers[:]) for logger in loggers]
    yield
    for logger, (level, handlers) in zip(loggers, before, strict=True):
        logger.setLevel(level)
        logger.handlers[:] = handlers


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "data", free_bytes=0)


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A service's database without rows: to migrate one for each test takes longer than most do."""
    path = tmp_path_factory.mktemp("empty") / "jobs.sqlite"
    engine = database.connect(f"sqlite:///{path}")
    queue.migrate(engine)
    migrations.upgrade(engine)
    engine.dispose()
    return path


@pytest.fixture
def engine(tmp_path: Path, empty_database: Path) -> Iterator[sa.Engine]:
    path = shutil.copyfile(empty_database, tmp_path / "jobs.sqlite")
    engine = database.connect(f"sqlite:///{path}")
    yield engine
    engine.dispose()


@pytest.fixture
def connection(engine: sa.Engine) -> Iterator[sa.Connection]:
    """A transaction."""
    with engine.begin() as connection:
        yield connection


@pytest.fixture
def storage(tmp_path: Path) -> Storage:
    """A store in a folder."""
    return storage_at((tmp_path / "a store").as_uri())


@pytest.fixture(scope="session")
def child_server() -> Iterator[ForkServer]:
    """The fork server of all tests: it takes longer to start than most of them take."""
    with contextlib.closing(sandbox.fork_server(1, pairs=True)) as server:
        server.start()
        yield server


@pytest.fixture
def context(
    settings: Settings,
    empty_database: Path,
    child_server: ForkServer,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Context]:
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(empty_database, str(sa.make_url(settings.database_url).database))
    monkeypatch.setattr(sandbox, "fork_server", lambda *_, **__: child_server)
    monkeypatch.setattr(child_server, "close", lambda: None)  # other tests go on with it
    with open_context(settings) as context:
        yield context


@pytest.fixture(scope="session")
def server() -> Iterator[tuple[FastAPI, str]]:
    """The app on a port, and its URL."""
    app = create_app()
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_config=None))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started and thread.is_alive():
        time.sleep(0.01)
    host, port = server.servers[0].sockets[0].getsockname()
    yield app, f"http://{host}:{port}"
    server.should_exit = True
    thread.join()


@pytest.fixture
def http(server: tuple[FastAPI, str], context: Context) -> Iterator[httpx.Client]:
    """The API on a fresh database, without a worker: what is queued stays queued."""
    app, url = server
    app.state.context = context
    hooks: dict[str, list[Callable[..., None]]] = {
        "response": [partial(check_described, described(app))]
    }
    # without certificates, which nobody has here: to read them takes longer than most tests
    with httpx.Client(base_url=url, timeout=60, event_hooks=hooks, verify=False) as client:
        yield client


@pytest.fixture
def client(http: httpx.Client) -> Iterator[Client]:
    """What people's commands ask the service with."""
    with Client(str(http.base_url)) as client:
        yield client


@pytest.fixture
def cameras_in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do what the routes ask of a camera in this process."""
    ask_in_process(monkeypatch)


@pytest.fixture
def capture(http: httpx.Client) -> Callable[..., httpx.Response]:
    """Ask the simulated camera for pairs, of a service with_cameras."""
    http.get("/cameras").raise_for_status()
    return lambda **wanted: http.post(f"{PATH}/captures", json=wanted)


@pytest.fixture
def finish(context: Context) -> Callable[[str, dict[str, bytes]], None]:
    """Do a worker's part: end a queued job with these results by name."""

    def end(job_id: str, files: dict[str, bytes]) -> None:
        with context.engine.begin() as connection:
            job = attempts.claim(connection, job_id, "a worker")
        assert job is not None
        results = []
        for name, data in files.items():
            context.storage.put(results_key(job_id, job.attempt, name), data)
            results.append(
                {
                    "name": name,
                    "size": len(data),
                    "sha256": f"{len(data):064x}",
                    "media_type": media_type(name),
                }
            )
        with context.engine.begin() as connection:
            assert attempts.succeed(connection, job, results)

    return end


@pytest.fixture(scope="session")
def png() -> Callable[..., bytes]:
    """Encode a PNG of this width and height, as without the flash or with it."""

    def encode(width: int, height: int, flash: bool = False) -> bytes:
        ramp = np.linspace(20, 230 if flash else 120, width * height * 3)
        ramp = ramp.reshape(height, width, 3) * (1.0, 0.8, 0.5)  # grey ones are refused
        file = io.BytesIO()
        Image.fromarray(ramp.astype(np.uint8)).save(file, "PNG")
        return file.getvalue()

    return encode


@pytest.fixture
def pair(tmp_path: Path, png: Callable[..., bytes]) -> list[str]:
    """Paths of two frames of 64 × 48 pixels."""
    paths = [tmp_path / "a.png", tmp_path / "b.png"]
    for path in paths:
        path.write_bytes(png(64, 48, path is paths[1]))
    return [str(path) for path in paths]
