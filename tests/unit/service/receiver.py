"""A receiver of webhooks."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, NamedTuple

from standardwebhooks import Webhook

SECRET = "whsec_QUJDREVGR0hJSktMTU5PUFFSU1RVVldYWVo="


class Told(NamedTuple):
    """A request that came, its signature verified."""

    path: str
    headers: dict[str, str]
    event: dict[str, Any]


class Receiver:
    """Answers with these statuses in turn, the last one for good; keeps what came."""

    def __init__(self, *statuses: int, **headers: str) -> None:
        self.told: queue.Queue[Told] = queue.Queue()
        self.before: Callable[[], None] = lambda: None  # called before each answer
        receiver, left = self, list(statuses)

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["content-length"]))
                got = {name.lower(): value for name, value in self.headers.items()}
                event = Webhook(SECRET).verify(body, got)
                receiver.before()
                receiver.told.put(Told(self.path, got, event))
                self.send_response(left.pop(0) if len(left) > 1 else left[0])
                for name, value in headers.items():
                    self.send_header(name.replace("_", "-"), value)
                self.send_header("content-length", "0")
                self.end_headers()

            def log_message(self, format: str, *arguments: object) -> None:
                """Stay quiet."""

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/hook?token=hidden"

    def next(self) -> Told:
        """Wait for the next request."""
        return self.told.get(timeout=120)


@contextlib.contextmanager
def receiving(*statuses: int, **headers: str) -> Iterator[Receiver]:
    """Run a receiver for as long as the block."""
    receiver = Receiver(*statuses, **headers)
    thread = threading.Thread(target=receiver.server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    try:
        yield receiver
    finally:
        receiver.server.shutdown()
        receiver.server.server_close()
        thread.join()
