"""What a service bears: python -m tests.bench.load --setup sqlite|postgresql.

Prints how long uploads of 12 MP pairs wait for their 202 with 1, 8 and 64 clients at once, how many
the API takes a second, what it holds in memory at most, and how much faster two workers are than
one with jobs of one thread, beside two bare processes that do the same without a service: what the
machine has to give. PostgreSQL comes with an S3 server, which keeps its objects in memory.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
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
from tests.chaos.service import SETUPS, Host, grown_up
from tests.ports import free_port

_CLIENTS = (1, 8, 64)
_EACH = 3
_LEAST = 24
_JOBS = 8
_WORKERS = (1, 2)
_PATIENCE_SECONDS = 600.0
_ONE_THREAD = {"OPENCV_FOR_THREADS_NUM": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_REPEATED = 3
_CAMERA = "sim://studio?lights=2&width=600&height=400&format=jpeg"
_BARE = """
import shutil, sys
from pathlib import Path
from pipeline import Options, Progress, separate_files
folder, jobs, number = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
pair = [(folder / frame).read_bytes() for frame in ("no_flash", "flash")]
def separate():
    separate_files(*pair, Options(), folder / f"results{number}", Progress())
    shutil.rmtree(folder / f"results{number}")
separate()
print(flush=True)
sys.stdin.read()
for _ in range(jobs):
    separate()
"""

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
    with tempfile.TemporaryDirectory(prefix="load-") as name, _running(setup) as (hosts, url):
        folder = Path(name)
        _say(f"setup={setup}, pairs of {sum(map(len, large.values())) / 2**20:.1f} MiB")
        _say("| clients | uploads | p50, s | p99, s | a second | API at most, MiB |")
        _say("|---:|---:|---:|---:|---:|---:|")
        for clients in _CLIENTS:
            _say(_accept(hosts, url, large, clients))
        _say("| | jobs | one, s | two, s | two against one |")
        _say("|---|---:|---:|---:|---:|")
        pair = _made_pair(folder)
        for _ in range(_REPEATED):  # by turns, for what else the machine does
            _say(speedup("bare processes", [_bare(folder, count) for count in _WORKERS]))
            _say(speedup("workers", [_work(hosts, url, pair, count) for count in _WORKERS]))


@contextlib.contextmanager
def _running(setup: str) -> Iterator[tuple[list[Host], str]]:
    with tempfile.TemporaryDirectory(prefix="load-") as name:
        folder = Path(name)
        if setup == "sqlite":
            # Not that of chaos, whose disk is small.
            port = free_port()
            host = Host(folder / "host", ["serve", "--no-worker"], port=port)
            try:
                yield from _answering([host], f"http://127.0.0.1:{port}")
            finally:
                host.kill()
            return
        with grown_up(folder, relayed=False) as service:
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
    return accepted(clients, waited, seconds, held)


def accepted(clients: int, waited: list[float], seconds: float, held: float) -> str:
    """Write a row: of uploads that waited so long each, so many seconds in all; held: MiB."""
    middle, worst = np.quantile(waited, [0.5, 0.99])
    count = len(waited)
    return (
        f"| {clients} | {count} | {middle:.2f} | {worst:.2f} | {count / seconds:.1f} | {held:.0f} |"
    )


def speedup(what: str, seconds: list[float]) -> str:
    """Write a row: what one and what two of a kind took for the same jobs."""
    one, two = seconds
    return f"| {what} | {_JOBS} | {one:.1f} | {two:.1f} | {one / two:.2f} |"


def _work(hosts: list[Host], url: str, pair: Pair, workers: int) -> float:
    with httpx.Client(base_url=url, timeout=60) as http, contextlib.ExitStack() as stack:
        for host in _worker_hosts(hosts, workers):
            stack.callback(host.kill)
            before = _readies(host)
            host.start()
            _await(lambda host=host, before=before: _readies(host) > before)  # type: ignore[misc]
        begin = time.monotonic()
        left = [http.post("/jobs", files=pair).raise_for_status().json() for _ in range(_JOBS)]
        while left:  # one long look at a time: looks are work, too
            if _state(http, left[0]) == "succeeded":
                left.pop(0)
        return time.monotonic() - begin


def _readies(host: Host) -> int:
    return host.log.read_text().count('"message": "ready"') if host.log.exists() else 0


def _bare(folder: Path, processes: int) -> float:
    """Seconds for the same jobs in processes that share nothing, from their first job on."""
    share = [sys.executable, "-c", _BARE, str(folder), str(_JOBS // processes)]
    running = [
        subprocess.Popen([*share, str(number)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        for number in range(processes)
    ]
    for process in running:  # each has imported what it needs
        assert process.stdout is not None and process.stdout.readline()
    begin = time.monotonic()
    for process in running:
        assert process.stdin is not None
        process.stdin.close()
    for process in running:
        if process.wait():
            sys.exit("load: a bare process failed")
        process.stdout.close()  # type: ignore[union-attr]
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


def _made_pair(folder: Path) -> Pair:
    """Take a pair; it lies in the folder, too."""
    with drivers.open_camera(_CAMERA) as camera:
        pair = drivers.capture_pair(camera)
    made = {"no_flash": pair.no_flash.best, "flash": pair.flash.best}
    for frame, data in made.items():
        (folder / frame).write_bytes(data)
    return made


def _state(http: httpx.Client, job: dict[str, Any]) -> str:
    answer = http.get(job["links"]["self"], headers={"prefer": "wait=30"}, timeout=60)
    state: str = answer.raise_for_status().json()["state"]
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


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
