"""The service under test in both set-ups: its hosts, its database and its store."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import httpx

from service.opening import migrate_database
from service.settings import MIB, Settings
from tests.chaos import processes
from tests.chaos.processes import Process
from tests.chaos.relay import Relay
from tests.ports import free_port
from tests.postgresql import PostgreSQL, find_programs

_PATIENCE_SECONDS = 60
_STORE_SECONDS = 120  # its first answer takes long
_DISK_BYTES = 512 * MIB


class Host:
    """A machine of the service: one command with a data folder and a log of its own."""

    def __init__(self, folder: Path, command: Sequence[str], **settings: object) -> None:
        self.data = folder / "data"
        self.data.mkdir(parents=True)
        self.log = folder / "log"
        self.command = command
        self.disk: Path | None = None
        """A file system of its own, if it has one."""
        self.relay: Relay | None = None
        """Its way to the database, if that can be cut."""
        self._settings = {"data_dir": self.data, "free_bytes": 16 * MIB, **settings}
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def works(self) -> bool:
        """Whether it runs jobs."""
        return "--no-worker" not in self.command

    @property
    def answers(self) -> bool:
        """Whether it has an API."""
        return "serve" in self.command

    def start(self) -> None:
        """Start it, unless it runs."""
        if self._process is not None and self._process.poll() is None:
            return
        environment = {f"LIGHTLAYERS_{k.upper()}": str(v) for k, v in self._settings.items()}
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "service.cli", *self.command],
                env={**os.environ, **environment},
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def processes(self, role: str = "") -> list[Process]:
        """Its living processes, of one role or all."""
        found = processes.of_folder(self.data)
        return [process for process in found if role in ("", process.role)]

    def kill(self) -> None:
        """Kill all of it with -9."""
        processes.send(signal.SIGKILL, self.processes())
        if self._process is not None:
            self._process.wait()

    def stop(self) -> None:
        """Ask it to end. Raises subprocess.TimeoutExpired."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait(_PATIENCE_SECONDS)


class Service:
    """A set-up and the ways to break and mend it."""

    def __init__(
        self,
        hosts: list[Host],
        urls: list[str],
        settings: Settings,
        database: PostgreSQL | None = None,
        store: Relay | None = None,
    ) -> None:
        self.hosts = hosts
        self.urls = urls
        self.settings = settings
        """With which database and store are reached from here, whatever is cut."""
        self.database = database
        self.store = store

    def start(self) -> None:
        """Start what does not run."""
        for host in self.hosts:
            host.start()


@contextlib.contextmanager
def embedded(folder: Path) -> Iterator[Service]:
    """One `lightlayers serve` on SQLite and a folder, on a small disk where that can be made."""
    with _disk(folder / "host") as disk:
        port = free_port()
        host = Host(folder / "host", ["serve"], port=port)
        host.disk = disk
        settings = Settings(data_dir=host.data)
        with _ending([host]):
            yield Service([host], [f"http://127.0.0.1:{port}"], settings)


@contextlib.contextmanager
def grown_up(folder: Path, relayed: bool = True) -> Iterator[Service]:
    """Two API hosts and two worker hosts on PostgreSQL and an S3 server.

    relayed: whether the ways to the store, and of workers to the database, can be cut.
    """
    programs = find_programs()
    if programs is None:
        sys.exit("chaos: PostgreSQL is not installed.")
    database = PostgreSQL(folder / "postgresql", programs)
    database.create()
    with contextlib.ExitStack() as stack:
        stack.callback(database.stop)
        store_port = stack.enter_context(_s3(folder / "s3"))
        store = Relay(store_port) if relayed else None
        os.environ |= _s3_variables(store.port if store else store_port)
        bucket = f"{os.environ['AWS_ENDPOINT_URL']}/photographs"
        httpx.put(bucket, timeout=_STORE_SECONDS).raise_for_status()
        store_url = "s3://photographs/chaos"
        ports = [free_port(), free_port()]
        hosts = [
            Host(
                folder / f"api{number}",
                ["serve", "--no-worker"],
                port=port,
                database_url=database.url(),
                store_url=store_url,
            )
            for number, port in enumerate(ports)
        ]
        for number in range(2):
            relay = Relay(database.port) if relayed else None
            url = database.url(relay.port if relay else None)
            there = folder / f"worker{number}"
            host = Host(there, ["worker"], database_url=url, store_url=store_url)
            host.relay = relay
            hosts.append(host)
        stack.enter_context(_ending(hosts))
        settings = Settings(data_dir=folder, database_url=database.url(), store_url=store_url)
        migrate_database(settings)
        urls = [f"http://127.0.0.1:{port}" for port in ports]
        yield Service(hosts, urls, settings, database, store)


SETUPS = {"sqlite": embedded, "postgresql": grown_up}


@contextlib.contextmanager
def _ending(hosts: list[Host]) -> Iterator[None]:
    try:
        yield
    finally:
        for host in hosts:
            host.kill()


@contextlib.contextmanager
def _disk(folder: Path) -> Iterator[Path | None]:
    """A small file system at a folder, None where this user may not mount one."""
    folder.mkdir()
    mounted = (
        os.geteuid() == 0
        and not subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={_DISK_BYTES}", "chaos", str(folder)],
            check=False,
            capture_output=True,
        ).returncode
    )
    try:
        yield folder if mounted else None
    finally:
        if mounted:
            for log in folder.glob("log"):
                shutil.copy(log, folder.with_suffix(".log"))
            subprocess.run(["umount", "--lazy", str(folder)], check=True)


@contextlib.contextmanager
def _s3(folder: Path) -> Iterator[int]:
    """An S3 server in a process of its own: its port."""
    folder.mkdir()
    port = free_port()
    with (folder / "log").open("wb") as log:
        command = [sys.executable, "-m", "moto.server", "-p", str(port)]
        server = subprocess.Popen(command, stdout=log, stderr=log, cwd=folder)
    try:
        transport = httpx.HTTPTransport(retries=8)
        with httpx.Client(transport=transport, timeout=_STORE_SECONDS) as client:
            client.get(f"http://127.0.0.1:{port}/")
        yield port
    finally:
        server.kill()
        server.wait()


def _s3_variables(port: int) -> dict[str, str]:
    return {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}",
        "AWS_ALLOW_HTTP": "true",
        "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
    }
