"""Sends requests byte by byte, as no well-behaved client would."""

from __future__ import annotations

import json
import socket
from dataclasses import dataclass
from typing import Any

_PATIENCE_SECONDS = 120
_ANSWER_BYTES = 4 * 1024 * 1024


class SilentError(Exception):
    """The service did not answer in time."""


@dataclass(frozen=True)
class Answer:
    """What came back; status 0 when the connection was closed without a word."""

    status: int
    headers: dict[str, str]
    body: bytes

    def json(self) -> dict[str, Any]:
        """Read a body of JSON."""
        value: dict[str, Any] = json.loads(self.body)
        return value


class Wire:
    """Where the service listens."""

    def __init__(self, port: int) -> None:
        self._port = port

    def send(
        self, method: str, path: str, headers: dict[str, str] | None = None, body: bytes = b""
    ) -> Answer:
        """Send one request of this body, with its length unless headers tell another."""
        told = {"Host": "localhost", "Connection": "close", "Content-Length": str(len(body))}
        told |= headers or {}
        head = f"{method} {path} HTTP/1.1\r\n"
        head += "".join(f"{name}: {value}\r\n" for name, value in told.items())
        broken_off = told["Content-Length"] != str(len(body))
        return self.send_bytes(head.encode("latin-1") + b"\r\n" + body, broken_off)

    def send_bytes(self, data: bytes, broken_off: bool) -> Answer:
        """Send bytes and read the answer. Raises SilentError.

        broken_off: close our half first, which to the service is a connection that breaks.
        """
        received = b""
        with socket.create_connection(("127.0.0.1", self._port), _PATIENCE_SECONDS) as connection:
            try:
                connection.sendall(data)
                if broken_off:
                    connection.shutdown(socket.SHUT_WR)
            except (BrokenPipeError, ConnectionResetError):
                pass  # refused before all was sent: there may be an answer
            try:
                while len(received) < _ANSWER_BYTES and (chunk := connection.recv(65536)):
                    received += chunk
            except ConnectionResetError:
                pass
            except TimeoutError as error:
                raise SilentError from error
        return _parse(received)


def _parse(received: bytes) -> Answer:
    head, _, body = received.partition(b"\r\n\r\n")
    lines = head.decode("latin-1").split("\r\n")
    words = lines[0].split(" ")
    if len(words) < 2 or not words[1].isdecimal():
        return Answer(0, {}, b"")
    headers = dict(line.lower().split(": ", 1) for line in lines[1:] if ": " in line)
    return Answer(int(words[1]), headers, body)
