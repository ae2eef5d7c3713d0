"""The compose file, as far as it can be held without containers; `make image` runs it."""

from __future__ import annotations

import contextlib
import re
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest
import sqlalchemy as sa
import yaml
from prometheus_client import CollectorRegistry, start_http_server

from service.cli import run
from service.counters import TAKEOVERS
from service.metrics import Database
from service.settings import Settings
from tests.ports import free_port

_DOCKER = Path(__file__).parents[2] / "docker"
_OURS = ("api", "worker", "migrate", "bucket")


@pytest.fixture(scope="module")
def services() -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load((_DOCKER / "compose.yaml").read_text())["services"]
    return content


@pytest.fixture
def check(services: dict[str, Any]) -> Callable[[str, int], int]:
    """Run the health check of a service at a port of this machine; its exit code."""

    def run_check(name: str, port: int) -> int:
        program, python, *words = services[name]["healthcheck"]["test"]
        assert (program, python) == ("CMD", "python")
        here = [re.sub(r"127\.0\.0\.1:\d+", f"127.0.0.1:{port}", word) for word in words]
        # as Docker sets for each container where its own settings name a proxy
        proxy = {"http_proxy": f"http://127.0.0.1:{free_port()}"}
        return subprocess.run([sys.executable, *here], env=proxy, timeout=60).returncode

    return run_check


@pytest.fixture
def serve_metrics() -> Iterator[Callable[[sa.Engine], int]]:
    """Serve metrics of a process with a database; the port."""
    with contextlib.ExitStack() as stack:

        def serve(engine: sa.Engine) -> int:
            registry = CollectorRegistry()
            registry.register(Database(engine, 15))
            registry.register(TAKEOVERS)
            port = free_port()
            server, _ = start_http_server(port, "127.0.0.1", registry)
            stack.callback(server.server_close)
            stack.callback(server.shutdown)
            return port

        yield serve


@pytest.mark.parametrize("name", _OURS)
def test_our_containers_may_do_no_more_than_they_must(name: str, services: dict[str, Any]) -> None:
    service = services[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert not {"privileged", "user", "cap_add"} & set(service)


@pytest.mark.parametrize("name", ["api", "worker", "migrate"])
def test_commands_and_variables_are_those_of_the_program(
    name: str, services: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    service = services[name]
    known = {f"LIGHTLAYERS_{setting.upper()}" for setting in Settings.model_fields}
    given = {key for key in service["environment"] if key.startswith("LIGHTLAYERS_")}
    assert {"LIGHTLAYERS_DATABASE_URL", "LIGHTLAYERS_STORE_URL"} <= given <= known
    flags = [word for word in service["command"] if word.startswith("--")]
    assert run([service["command"][0], "--help"]) == 0
    helped = capsys.readouterr().out
    assert all(flag in helped for flag in flags)


def test_processes_start_in_order_and_stop_in_their_time(services: dict[str, Any]) -> None:
    assert services["worker"]["deploy"]["replicas"] == 2
    for name in ("api", "worker"):
        assert services[name]["depends_on"]["migrate"] == {
            "condition": "service_completed_successfully"
        }
        assert services[name]["healthcheck"]["test"][0] == "CMD"
    drain = float(services["api"]["environment"]["LIGHTLAYERS_DRAIN_SECONDS"])
    grace = float(services["api"]["stop_grace_period"].removesuffix("s"))
    assert drain + Settings.model_fields["stop_seconds"].default < grace


@pytest.mark.parametrize("name", ["api", "worker"])
def test_health_is_asked_of_the_container_itself(
    name: str, check: Callable[[str, int], int], serve_metrics: Callable[[sa.Engine], int]
) -> None:
    assert check(name, serve_metrics(sa.create_engine("sqlite://"))) == 0
    assert check(name, free_port()) != 0


def test_a_worker_is_alive_while_its_database_hangs(
    check: Callable[[str, int], int], serve_metrics: Callable[[sa.Engine], int]
) -> None:
    """It goes on with its job meanwhile, which ends with it where the unhealthy are replaced."""
    over = threading.Event()

    def hang() -> NoReturn:
        over.wait(60)
        raise sqlite3.OperationalError

    port = serve_metrics(sa.create_engine("sqlite://", creator=hang))
    try:
        assert check("worker", port) == 0
    finally:
        over.set()


def test_the_migration_waits_for_the_database_itself(services: dict[str, Any]) -> None:
    """While a new one is set up, another server answers, on its socket alone."""
    test = services["database"]["healthcheck"]["test"]
    assert test[test.index("-h") + 1] == "127.0.0.1"
    assert services["migrate"]["restart"] == "on-failure"


def test_ports_are_open_on_loopback_only(services: dict[str, Any]) -> None:
    published = {name: service.get("ports", []) for name, service in services.items()}
    assert published.pop("api") == ["127.0.0.1:8000:8000"]
    assert not any(published.values())


def test_the_image_runs_without_root() -> None:
    last = (_DOCKER / "Dockerfile").read_text().rpartition("\nFROM ")[2]
    made = re.search(r"groupadd --gid (\d+) .*useradd --uid (\d+) --gid \1 ", last, re.DOTALL)
    assert made is not None
    # a name is refused where the host sees to it (Kubernetes' runAsNonRoot)
    assert re.search(rf"^USER {made[2]}:{made[1]}$", last, re.MULTILINE)
