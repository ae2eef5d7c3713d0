"""A way to a server that can be cut, as a switch or a cable would be."""

from __future__ import annotations

import contextlib
import socket
import threading


class Relay:
    """Passes connections on to a port of this machine while it is up."""

    def __init__(self, target: int) -> None:
        self._target = target
        self._up = True
        self._left: int | None = None
        self._lock = threading.Lock()
        self._sockets: set[socket.socket] = set()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._server.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Break all connections, and every new one, until it is mended."""
        with self._lock:
            self._up = False
            sockets, self._sockets = self._sockets, set()
        for one in sockets:
            _break(one)

    def cut_after(self, count: int) -> None:
        """Break all connections once so many bytes more have passed."""
        self._left = count

    def mend(self) -> None:
        """Let connections pass again."""
        with self._lock:
            self._up, self._left = True, None

    def _accept(self) -> None:
        while True:
            client, _ = self._server.accept()
            try:
                server = socket.create_connection(("127.0.0.1", self._target))
            except OSError:
                client.close()
                continue
            with self._lock:
                if self._up:
                    self._sockets |= {client, server}
            for one, other in ((client, server), (server, client)):
                if not self._holds(client):
                    _break(one)
                    continue
                threading.Thread(target=self._pass, args=(one, other), daemon=True).start()

    def _holds(self, one: socket.socket) -> bool:
        with self._lock:
            return one in self._sockets

    def _pass(self, source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                target.sendall(data)
                if self._left is not None and (left := self._left - len(data)) <= 0:
                    self._left = None
                    self.cut()
                elif self._left is not None:
                    self._left = left
        with self._lock:
            self._sockets -= {source, target}
        _break(source)
        _break(target)


def _break(one: socket.socket) -> None:
    with contextlib.suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
    one.close()
