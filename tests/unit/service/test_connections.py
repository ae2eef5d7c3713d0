from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator

import pytest
import uvicorn
from starlette.types import Receive, Scope, Send

from service.connections import PatientProtocol


async def _app(scope: Scope, _receive: Receive, send: Send) -> None:
    if scope["type"] == "http":
        headers = [(b"content-length", b"2")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": b"ok"})


class _Hasty(PatientProtocol):
    head_seconds = 0.5


@pytest.fixture(scope="module")
def address() -> Iterator[tuple[str, int]]:
    """A server that does not wait for the head of a request."""
    with _serving(_Hasty) as address:
        yield address


@contextlib.contextmanager
def _serving(protocol: type[PatientProtocol]) -> Iterator[tuple[str, int]]:
    config = uvicorn.Config(_app, port=0, http=protocol, log_config=None, lifespan="off")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started and thread.is_alive():
        time.sleep(0.01)
    yield server.servers[0].sockets[0].getsockname()
    server.should_exit = True
    thread.join()


def _is_cut(client: socket.socket) -> bool:
    try:
        return client.recv(1000) == b""
    except ConnectionResetError:
        return True


def _drip(client: socket.socket) -> bool:
    """Send a header a letter at a time until the connection is gone."""
    try:
        for _ in range(3000):
            client.sendall(b"a")
            client.settimeout(0.02)
            try:
                if client.recv(1000) == b"":
                    return True
            except TimeoutError:
                continue
    except (ConnectionResetError, BrokenPipeError):
        return True
    return False


@pytest.mark.parametrize("begun", [b"", b"GET / HTTP/1.1\r\nHost: localhost\r\n"])
def test_a_head_that_does_not_come_ends_the_connection(
    begun: bytes, address: tuple[str, int]
) -> None:
    with socket.create_connection(address, timeout=60) as client:
        client.sendall(begun)
        assert _is_cut(client)


@pytest.mark.parametrize("before", [b"", b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"])
def test_a_head_that_drips_ends_the_connection(before: bytes, address: tuple[str, int]) -> None:
    with socket.create_connection(address, timeout=60) as client:
        if before:
            client.sendall(before)
            assert client.recv(1000).startswith(b"HTTP/1.1 200")
        client.sendall(b"GET / HTTP/1.1\r\nX-Slow: ")
        assert _drip(client)


def test_requests_one_after_the_other_are_answered() -> None:
    with (
        _serving(PatientProtocol) as address,
        socket.create_connection(address, timeout=60) as client,
    ):
        for _ in range(3):
            client.sendall(b"GET / HTTP/1.1\r\nHost: ")
            client.sendall(b"localhost\r\n\r\n")
            answer = b""
            while not answer.endswith(b"ok"):
                answer += client.recv(1000)
            assert answer.startswith(b"HTTP/1.1 200")
