from __future__ import annotations

import socket
import threading

import pytest

from service.doctor.finding import Finding
from service.settings import Settings
from tests.ports import free_port
from tests.unit.service.findings import Look


@pytest.mark.parametrize("name", ["port", "metrics_port"])
def test_a_port_of_something_else_is_told(
    name: str, look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        monkeypatch.setenv(f"LIGHTLAYERS_{name.upper()}", str(other.getsockname()[1]))
        monkeypatch.setattr("service.doctor.ports._asked", lambda _url: "something else")
        assert look()[name].grade == "wrong"
        ours = {"port": '{"status":"ok"}', "metrics_port": "lightlayers_database_up 1.0"}
        monkeypatch.setattr("service.doctor.ports._asked", lambda _url: ours[name])
        assert look()[name].grade == "ok"


@pytest.mark.parametrize("host", ["[::1", "0.0.0.0:1", "300.1.1.1", "a\x7fb"])
def test_an_address_that_is_none_is_told(
    host: str, look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_HOST", host)
    monkeypatch.setenv("LIGHTLAYERS_KEYS", "loopback")
    found = look()["port"]
    assert found.grade == "wrong"
    assert f" of {host} cannot be listened on (" in found.sentence
    assert found.sentence.endswith("set another LIGHTLAYERS_PORT or LIGHTLAYERS_HOST.")


def test_a_service_of_this_machine_is_asked_without_the_proxy(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("http_proxy", "HTTP_PROXY"):
        monkeypatch.setenv(name, f"http://127.0.0.1:{free_port()}")
    answer = b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n" + b'{"status":"ok"}'
    with socket.create_server(("127.0.0.1", 0)) as service:

        def serve() -> None:
            connection, _ = service.accept()
            with connection:
                connection.recv(65536)
                connection.sendall(answer)

        threading.Thread(target=serve, daemon=True).start()
        port = service.getsockname()[1]
        monkeypatch.setenv("LIGHTLAYERS_PORT", str(port))
        found = look()["port"]
    assert found == Finding("ok", "port", f"lightlayers answers at {port} of 127.0.0.1.")


def test_a_port_of_something_else_is_told_that_the_worker_of_serve_would_take(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.doctor.ports._asked", lambda _url: "something else")
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        monkeypatch.setenv("LIGHTLAYERS_METRICS_PORT", str(port - 1))
        found = look()["worker's metrics_port"]
    assert found.grade == "wrong"
    assert found.sentence.startswith(f"{port} of 127.0.0.1 cannot be listened on")
    advice = "set another LIGHTLAYERS_METRICS_PORT or LIGHTLAYERS_METRICS_HOST."
    assert found.sentence.endswith(advice)


@pytest.mark.parametrize(("below", "part"), [(0, "metrics_port"), (1, "worker's metrics_port")])
def test_one_port_for_two_is_told_before_either_is_listened_on(
    below: int, part: str, look: Look, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_METRICS_PORT", str(settings.port - below))
    found = look()
    said = f"{settings.port} is the port of the service: set another LIGHTLAYERS_METRICS_PORT."
    assert found[part] == Finding("wrong", part, said)
    assert found["port"].grade == "ok"
