"""What a service bears: python -m tests.bench.load --setup sqlite|postgresql.

Prints how long uploads of 12 MP pairs wait for their 202 with 1, 8 and 64 clients at once, how many
the API takes a second, what it holds in memory at most, and how much faster two workers are than
one with jobs of one thread. PostgreSQL comes with an S3 server, which keeps its objects in memory.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import numpy as np

import drivers
from tests.bench.pairs import pair_files
from tests.chaos.service import SETUPS, Host

_CLIENTS = (1, 8, 64)
_EACH = 3
_LEAST = 24
_JOBS = 16
_WORKERS = (1, 2)
_PATIENCE_SECONDS = 600.0
_ONE_THREAD = {"OPENCV_FOR_THREADS_NUM": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_SMALL = "sim://studio?lights=2&width=480&height=320&format=jpeg"

Pair = dict[str, bytes]


def main() -> None:
    """Measure one set-up and print two tables."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--setup", choices=SETUPS, default="sqlite")
    setup = parser.parse_args().setup
    os.environ |= _ONE_THREAD | {
        "LIGHTLAYERS_QUEUED_JOBS": "100000",
        "LIGHTLAYERS_QUEUED_JOBS_PER_KEY": "100000",
    }
    no_flash, flash = (path.read_bytes() for path in pair_files("jpeg12_n2"))
    large = {"no_flash": no_flash, "flash": flash}
    with _running(setup) as (hosts, url):
        _say(f"setup={setup}, pairs of {sum(map(len, large.values())) / 2**20:.1f} MiB")
        _say("| clients | uploads | p50, s | p99, s | a second | API at most, MiB |")
        _say("|---:|---:|---:|---:|---:|---:|")
        for clients in _CLIENTS:
            _say(_accept(hosts, url, large, clients))
        _say("| workers | jobs | s | against one |")
        _say("|---:|---:|---:|---:|")
        small = _small_pair()
        alone = 0.0
        for workers in _WORKERS:
            seconds = _work(hosts, url, small, workers)
            alone = alone or seconds
            _say(f"| {workers} | {_JOBS} | {seconds:.1f} | {alone / seconds:.2f} |")


@contextlib.contextmanager
def _running(setup: str) -> Iterator[tuple[list[Host], str]]:
    with tempfile.TemporaryDirectory(prefix="load-") as name:
        folder = Path(name)
        if setup == "sqlite":
            # Not that of chaos, whose disk is small.
            port = _free_port()
            host = Host(folder / "host", ["serve", "--no-worker"], port=port)
            try:
                yield from _answering([host], f"http://127.0.0.1:{port}")
            finally:
                host.kill()
            return
        with SETUPS[setup](folder) as service:
            yield from _answering(service.hosts, service.urls[0])


def _answering(hosts: list[Host], url: str) -> Iterator[tuple[list[Host], str]]:
    hosts[0].start()

    def answers() -> bool:
        with contextlib.suppress(httpx.HTTPError):
            return httpx.get(f"{url}/healthz").status_code == 200
        return False

    _await(answers)
    yield hosts, url


def _accept(hosts: list[Host], url: str, pair: Pair, clients: int) -> str:
    count = max(clients * _EACH, _LEAST)
    waited: list[float] = []
    jobs: list[str] = []
    started = threading.Barrier(clients)

    def send(number: int) -> None:
        with httpx.Client(base_url=url, timeout=_PATIENCE_SECONDS) as http:
            if number < clients:
                started.wait()
            begin = time.monotonic()
            answer = http.post("/jobs", files=pair)
            waited.append(time.monotonic() - begin)
            jobs.append(answer.raise_for_status().json()["links"]["self"])

    begin = time.monotonic()
    with ThreadPoolExecutor(clients) as pool:
        list(pool.map(send, range(count)))
    seconds = time.monotonic() - begin
    held = max(_peak(process.pid) for process in hosts[0].processes("api"))
    with httpx.Client(base_url=url, timeout=_PATIENCE_SECONDS) as http:
        for job in jobs:
            http.delete(job).raise_for_status()
    middle, worst = np.quantile(waited, [0.5, 0.99])
    return (
        f"| {clients} | {count} | {middle:.2f} | {worst:.2f} | {count / seconds:.1f} | {held:.0f} |"
    )


def _work(hosts: list[Host], url: str, pair: Pair, workers: int) -> float:
    with httpx.Client(base_url=url, timeout=60) as http:
        made = [http.post("/jobs", files=pair).raise_for_status().json() for _ in range(_JOBS)]
        with contextlib.ExitStack() as stack:
            for host in _worker_hosts(hosts, workers):
                stack.callback(host.kill)
                host.start()
            _await(lambda: _state(http, made[0]) != "queued")
            begin = time.monotonic()  # both have imported by the time that the first has begun
            _await(lambda: all(_state(http, job) == "succeeded" for job in made))
            return time.monotonic() - begin


def _worker_hosts(hosts: list[Host], count: int) -> list[Host]:
    first = hosts[0]
    if len(hosts) > 1:
        return [host for host in hosts if host.works][:count]
    folder = Path(tempfile.mkdtemp(dir=first.data.parent))
    shared = {
        "database_url": f"sqlite:///{first.data / 'lightlayers.sqlite'}",
        "store_url": (first.data / "store").as_uri(),
    }
    return [Host(folder / str(number), ["worker"], **shared) for number in range(count)]


def _small_pair() -> Pair:
    with drivers.open_camera(_SMALL) as camera:
        pair = drivers.capture_pair(camera)
    return {"no_flash": pair.no_flash.best, "flash": pair.flash.best}


def _state(http: httpx.Client, job: dict[str, Any]) -> str:
    state: str = http.get(job["links"]["self"]).raise_for_status().json()["state"]
    if state in ("failed", "canceled", "expired"):
        sys.exit(f"load: a job ended as {state}")
    return state


def _peak(pid: int) -> float:
    """The most that a process has held, in MiB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def _await(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _PATIENCE_SECONDS
    while not happened():
        if time.monotonic() > deadline:
            sys.exit("load: waited in vain")
        time.sleep(0.1)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
    return port


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
