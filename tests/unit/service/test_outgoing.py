from __future__ import annotations

import contextlib
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import httpcore
import pytest

from service import outgoing
from service.addresses import parse_networks
from service.outgoing import Answer, UnansweredError, post

LOOPBACK = parse_networks("127.0.0.0/8")


@contextlib.contextmanager
def _server(
    serve: Callable[[socket.socket], None],
    address: str = "127.0.0.1",
    family: socket.AddressFamily = socket.AF_INET,
) -> Iterator[int]:
    """Serve one connection; its port."""
    with socket.create_server((address, 0), family=family) as listener:

        def accept() -> None:
            connection, _ = listener.accept()
            with connection, contextlib.suppress(OSError):
                serve(connection)

        thread = threading.Thread(target=accept)
        thread.start()
        yield listener.getsockname()[1]
        thread.join()


def _answering(text: str, seen: list[bytes]) -> Callable[[socket.socket], None]:
    def serve(connection: socket.socket) -> None:
        seen.append(connection.recv(65536))
        connection.sendall(text.encode())

    return serve


def _post(port: int, host: str = "127.0.0.1", seconds: float = 60) -> Answer:
    url = f"http://{host}:{port}/a?b=c"
    return post(url, {"content-type": "text/plain"}, b"body", LOOPBACK, seconds)


def test_status_and_retry_after_come_back_and_the_body_is_not_read() -> None:
    seen: list[bytes] = []
    head = "HTTP/1.1 503 Busy\r\nRetry-After: 7\r\nContent-Length: 99999999999\r\n\r\nbeginning"
    with _server(_answering(head, seen)) as port:
        assert _post(port) == Answer(503, "7")
    lines = seen[0].decode().lower().splitlines()
    assert lines[0] == "post /a?b=c http/1.1"
    assert {f"host: 127.0.0.1:{port}", "content-length: 4", "content-type: text/plain"} <= {*lines}


@pytest.mark.parametrize(
    ("place", "line"),
    [
        ("/hooks/a;v=1?b=c;d=e", "POST /hooks/a;v=1?b=c;d=e HTTP/1.1"),
        ("/hooks;a=1/b;", "POST /hooks;a=1/b; HTTP/1.1"),
        ("//twice/%3B", "POST //twice/%3B HTTP/1.1"),
        ("?b=c#d", "POST /?b=c HTTP/1.1"),
        ("", "POST / HTTP/1.1"),
    ],
)
def test_the_whole_url_is_called(place: str, line: str) -> None:
    seen: list[bytes] = []
    with _server(_answering("HTTP/1.1 204 Done\r\n\r\n", seen)) as port:
        assert post(f"http://127.0.0.1:{port}{place}", {}, b"", LOOPBACK, 60).status == 204
    assert seen[0].decode().splitlines()[0] == line


def test_an_ipv6_address_is_named_in_brackets() -> None:
    seen: list[bytes] = []
    private = parse_networks("::1/128")
    answer = _answering("HTTP/1.1 204 Done\r\n\r\n", seen)
    with _server(answer, "::1", socket.AF_INET6) as port:
        assert post(f"http://[::1]:{port}/a", {}, b"", private, 60).status == 204
    hosts = [each for each in seen[0].decode().splitlines() if each.lower().startswith("host:")]
    assert [each.partition(" ")[2] for each in hosts] == [f"[::1]:{port}"]


@pytest.mark.parametrize(
    ("url", "host"),
    [
        ("https://Example.org:443/a", "example.org"),
        ("http://example.org:443/a", "example.org:443"),
        ("http://[2001:DB8::1]/a", "[2001:db8::1]"),
        ("http://example.org:/a", "example.org"),
    ],
)
def test_a_host_is_named_without_the_port_that_is_usual(url: str, host: str) -> None:
    assert outgoing._target(url)[1] == host


def test_a_redirect_is_not_followed() -> None:
    seen: list[bytes] = []
    head = "HTTP/1.1 307 Elsewhere\r\nLocation: http://127.0.0.1:1/\r\nContent-Length: 0\r\n\r\n"
    with _server(_answering(head, seen)) as port:
        assert _post(port) == Answer(307, "")


def test_a_proxy_of_the_environment_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.1:1")
    with _server(_answering("HTTP/1.1 204 Done\r\n\r\n", [])) as port:
        assert _post(port).status == 204


@pytest.mark.parametrize("text", ["", "SSH-2.0-OpenSSH\r\n", "HTTP/1.1 999999\r\n\r\n"])
def test_what_is_no_http_is_no_answer(text: str) -> None:
    with _server(_answering(text, [])) as port, pytest.raises(UnansweredError, match="no HTTP"):
        _post(port)


def test_an_answer_that_comes_by_drops_does_not_last() -> None:
    stop = threading.Event()

    def drip(connection: socket.socket) -> None:
        connection.sendall(b"HTTP/1.1 200 OK\r\n")
        while not stop.wait(0.05):
            connection.sendall(b"x-more: 1\r\n")

    with _server(drip) as port:
        with pytest.raises(UnansweredError, match="too long"):
            _post(port, seconds=2)
        stop.set()


def test_a_port_without_a_server_is_no_answer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with pytest.raises(UnansweredError, match="no connection"):
        _post(port)


@pytest.mark.parametrize("host", ["[::1]", "10.0.0.1", "[::ffff:10.0.0.1]", "0xa.1", "167772161"])
def test_a_private_address_is_not_connected_to(host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        httpcore.SyncBackend, "connect_tcp", lambda *_args: pytest.fail("connected")
    )
    with pytest.raises(UnansweredError, match="forbidden"):
        _post(80, host)


def test_a_name_is_looked_up_once_and_what_was_checked_is_connected_to(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked_up: list[str] = []
    seen: list[bytes] = []

    def resolve(host: str, _port: int, _private: object, _seconds: float) -> list[str]:
        looked_up.append(host)
        return ["127.0.0.1"]

    monkeypatch.setattr(outgoing, "resolve", resolve)
    with _server(_answering("HTTP/1.1 200 OK\r\n\r\n", seen)) as port:
        assert _post(port, "hook.example").status == 200
    assert looked_up == ["hook.example"]
    assert f"host: hook.example:{port}" in seen[0].decode().lower()


def test_the_next_address_is_tried_when_one_does_not_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(outgoing, "resolve", lambda *_args: ["127.0.0.9", "127.0.0.1"])
    with _server(_answering("HTTP/1.1 200 OK\r\n\r\n", [])) as port:
        assert _post(port, "hook.example").status == 200


def test_a_name_whose_look_up_hangs_is_no_answer_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    over = threading.Event()
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_args, **_more: over.wait(60))
    started = time.monotonic()
    with pytest.raises(UnansweredError, match="too long"):
        _post(80, "hook.example", seconds=0.2)
    assert time.monotonic() - started < 10
    over.set()


def test_an_unknown_name_is_no_answer_and_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_args: object, **_more: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "hook.example is unknown")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(UnansweredError, match="no connection") as failure:
        _post(80, "hook.example")
    assert "hook.example" not in str(failure.value)


def test_tls_asks_for_the_name_and_not_for_the_address(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def start_tls(_stream: object, _context: ssl.SSLContext, name: str, _left: float) -> None:
        asked.append(name)
        raise httpcore.ConnectError("far enough")

    backend = httpcore.MockBackend([])
    monkeypatch.setattr(outgoing, "resolve", lambda *_args: ["8.8.8.8"])
    monkeypatch.setattr(
        httpcore.SyncBackend, "connect_tcp", lambda _self, *args: backend.connect_tcp(*args[:2])
    )
    monkeypatch.setattr(httpcore.MockStream, "start_tls", start_tls)
    with pytest.raises(UnansweredError):
        post("https://hook.example/", {}, b"", (), 5)
    assert asked == ["hook.example"]
