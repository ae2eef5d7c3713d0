"""Whether the ports can be listened on, or are this service's own already."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator

import httpx

from pipeline.errors import reason_of
from service.doctor.finding import Finding
from service.settings import Settings
from service.variables import PREFIX


def look(settings: Settings) -> Iterator[Finding]:
    """Look at the ports of the API and of metrics."""
    yield _port("port", settings.host, settings.port, "", _is_ours)
    ports = {
        "metrics_port": settings.metrics_port,
        "worker's metrics_port": settings.worker_metrics_port,
    }
    for part, port in ports.items():
        if port is None:
            continue
        if port == settings.port:
            said = f"{port} is the port of the service: set another {PREFIX}METRICS_PORT."
            yield Finding("wrong", part, said)
        else:
            yield _port(part, settings.metrics_host, port, "METRICS_", _is_metrics)


def _port(part: str, host: str, port: int, kind: str, ours: Callable[[str], bool]) -> Finding:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.create_server((host, port), family=family).close()
        return Finding("ok", part, f"{port} of {host} is free.")
    except OSError as error:
        local = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
        if ours(f"http://{f'[{local}]' if ':' in local else local}:{port}"):
            return Finding("ok", part, f"lightlayers answers at {port} of {host}.")
        return Finding(
            "wrong",
            part,
            f"{port} of {host} cannot be listened on ({reason_of(error)}): set another "
            f"{PREFIX}{kind}PORT or {PREFIX}{kind}HOST.",
        )


def _is_ours(url: str) -> bool:
    return '"status":"ok"' in _asked(f"{url}/healthz")


def _is_metrics(url: str) -> bool:
    return "lightlayers_database_up" in _asked(f"{url}/metrics")


def _asked(url: str) -> str:
    try:
        return httpx.get(url, timeout=5, trust_env=False).text  # no proxy reaches this machine
    except (httpx.HTTPError, httpx.InvalidURL):
        return ""
