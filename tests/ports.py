"""Ports for servers that start later, which the kernel gives to nobody else until then."""

from __future__ import annotations

import os
import random
import re
import socket

_FIRST = 12_000
_SHARE = 2_500  # of each of eight test workers: all lie below 32768, where the kernel's own begin
_drawn: set[int] = set()


def free_port(row: int = 1) -> int:
    """Draw a port that is free together with the next ones of a row; none is drawn twice."""
    worker = int(re.sub("[^0-9]", "", os.environ.get("PYTEST_XDIST_WORKER", "")) or 0) % 8
    first = _FIRST + worker * _SHARE
    while True:
        port = random.randrange(first, first + _SHARE - row)
        ports = range(port, port + row)
        if _drawn.isdisjoint(ports) and all(map(_is_free, ports)):
            _drawn.update(ports)
            return port


def _is_free(port: int) -> bool:
    try:
        socket.create_server(("127.0.0.1", port)).close()
    except OSError:
        return False
    return True
