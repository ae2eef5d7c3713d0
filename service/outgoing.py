"""One POST to a URL that a user gave: to no other place, and for no longer than it may take."""

from __future__ import annotations

import ssl
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import httpcore

from service.addresses import ForbiddenAddressError, Networks, resolve

_CONNECT_SECONDS = 5.0  # of those that an answer may take
_PORTS = {"http": 80, "https": 443}  # that a host's name goes without


class UnansweredError(Exception):
    """No answer came. The message is for logs and bears no address."""


@dataclass(frozen=True)
class Answer:
    """What came back; its body is not read. retry_after: the header, "" without one."""

    status: int
    retry_after: str


def post(
    url: str, headers: Mapping[str, str], body: bytes, private: Networks, seconds: float
) -> Answer:
    """Send a POST, for `seconds` in all at most; redirects are not followed, proxies not used.

    private: networks that may be called beside the public internet. The name is looked up once,
    every address of it is checked, and one of these is connected to, so that a name that changes
    what it means in between leads nowhere. Raises UnansweredError.
    """
    backend = _CheckedBackend(private, time.monotonic() + seconds)
    timeouts = {"connect": _CONNECT_SECONDS, "read": seconds, "write": seconds, "pool": seconds}
    try:
        target, host = _target(url)
        with (
            httpcore.ConnectionPool(network_backend=backend) as pool,
            pool.stream(
                "POST",
                target,
                headers=[("host", host), *headers.items()],
                content=body,
                extensions={"timeout": timeouts},
            ) as response,
        ):
            found = {name.lower(): value for name, value in response.headers}
            return Answer(response.status, found.get(b"retry-after", b"").decode("latin-1"))
    except ForbiddenAddressError as error:
        raise UnansweredError(f"forbidden: {error}") from None
    except (httpcore.TimeoutException, TimeoutError):
        raise UnansweredError("it took too long") from None
    # Nothing of the cause, which may quote the address or what was sent.
    except (httpcore.NetworkError, httpcore.ProtocolError, OSError, ValueError) as error:
        raise UnansweredError(f"no connection or no HTTP ({type(error).__name__})") from None


def _target(url: str) -> tuple[httpcore.URL, str]:
    """What to ask for, and the header that names the host."""
    # httpcore's own reading drops what follows a semicolon, and the brackets of IPv6 addresses.
    parts = urlsplit(url)
    host = parts.hostname or ""
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    named = f"[{host}]" if ":" in host else host
    if parts.port is not None and parts.port != _PORTS.get(parts.scheme):
        named += f":{parts.port}"
    return httpcore.URL(scheme=parts.scheme, host=host, port=parts.port, target=path), named


class _CheckedBackend(httpcore.NetworkBackend):
    """Connects to allowed addresses alone; its streams stop at the deadline."""

    def __init__(self, private: Networks, deadline: float) -> None:
        self._private = private
        self._deadline = deadline
        self._sockets = httpcore.SyncBackend()

    def connect_tcp(
        self,
        host: str,
        port: int,
        timeout: float | None = None,
        local_address: str | None = None,
        socket_options: Iterable[Any] | None = None,
    ) -> httpcore.NetworkStream:
        failure: Exception = httpcore.ConnectError("the name has no address")
        for address in resolve(host, port, self._private, _left(self._deadline, None)):
            try:
                left = _left(self._deadline, timeout)
                stream = self._sockets.connect_tcp(
                    address, port, left, local_address, socket_options
                )
            except (httpcore.ConnectError, httpcore.ConnectTimeout) as error:
                failure = error
            else:
                return _TimedStream(stream, self._deadline)
        raise failure


class _TimedStream(httpcore.NetworkStream):
    """A stream whose every step ends by the deadline, so that drop by drop does not last longer."""

    def __init__(self, stream: httpcore.NetworkStream, deadline: float) -> None:
        self._stream = stream
        self._deadline = deadline

    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:
        return self._stream.read(max_bytes, _left(self._deadline, timeout))

    def write(self, buffer: bytes, timeout: float | None = None) -> None:
        self._stream.write(buffer, _left(self._deadline, timeout))

    def close(self) -> None:
        self._stream.close()

    def start_tls(
        self,
        ssl_context: ssl.SSLContext,
        server_hostname: str | None = None,
        timeout: float | None = None,
    ) -> httpcore.NetworkStream:
        secured = self._stream.start_tls(
            ssl_context, server_hostname, _left(self._deadline, timeout)
        )
        return _TimedStream(secured, self._deadline)

    def get_extra_info(self, info: str) -> Any:
        return self._stream.get_extra_info(info)


def _left(deadline: float, timeout: float | None) -> float:
    left = deadline - time.monotonic()
    if left <= 0:
        raise httpcore.ReadTimeout("it took too long")
    return left if timeout is None else min(left, timeout)
