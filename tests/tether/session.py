"""A studio day: many pairs in a row through a service, from a simulated camera over PTP/IP.

The camera counts its releases and keeps the digest of each file; a job shows the digests of the
photographs it stored. So every pair is told from every other one, and from a swapped or mixed one.
"""

from __future__ import annotations

import contextlib
import hashlib
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from itertools import pairwise
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from typing import Any

import httpx

from drivers.clock import SystemClock
from drivers.ptp.codes import Response
from drivers.ptp.ip_packets import PacketStream
from drivers.sim.address import SimulatedCamera
from drivers.sim.body import Body, Refusal
from drivers.sim.files import Shooting
from drivers.sim.ip_responder import IpResponder
from tests.chaos.service import Host
from tests.ports import free_port

OPTIONS = {
    "quality": "fast",
    "method": "paper",
    "lights": 1,
    "align": False,
    "outputs": ["thumbnail.jpg"],
}
"""The least that can be asked of a separation: it is not what is measured."""

_WAITING = 3  # jobs that wait while one runs
_LOOK_S = 0.1
_SAMPLED = 10  # pairs between looks at the memory
_ENDED = ("succeeded", "failed", "canceled", "expired")
_PATIENCE_S = 120.0


@dataclass
class Release:
    """A photograph as the camera knows it. own_s: exposing, writing, developing and charging."""

    number: int
    fired: bool
    digests: list[str]
    own_s: float
    at: float  # of time.time(), when it was on the card


@dataclass
class Visit:
    """A connection to the camera: from when to when, of time.time()."""

    begun: float
    ended: float


@dataclass
class Diary:
    """What happened to the camera."""

    releases: list[Release] = field(default_factory=list)
    visits: list[Visit] = field(default_factory=list)


class WatchedBody(Body):
    """A camera that keeps a diary."""

    def __init__(self, options: SimulatedCamera) -> None:
        super().__init__(options, SystemClock())
        self.diary = Diary()
        self._charging_s = 0.0

    def release(self) -> None:
        """Press the release; where the flash is charging, that is the camera's own time."""
        try:
            super().release()
        except Refusal as refusal:
            if refusal.response is Response.DEVICE_BUSY and self._due is None:
                left = self._charged_at - self._clock.monotonic()
                self._charging_s = max(self._charging_s, left)
            raise

    def _photograph(self, shooting: Shooting) -> Any:
        begun = time.perf_counter()
        files = super()._photograph(shooting)
        developing_s = time.perf_counter() - begun
        own_s = float(shooting.time_s) + self.model.timing.write_s
        self.diary.releases.append(
            Release(
                self._releases,
                shooting.flash_fired,
                [hashlib.sha256(data).hexdigest() for _, _, data in files],
                own_s + developing_s + self._charging_s,
                time.time(),
            )
        )
        self._charging_s = 0.0
        return files


class WatchedResponder(IpResponder):
    """Notes when initiators come and go."""

    body: WatchedBody

    def _welcome(self, stream: PacketStream) -> None:
        begun = time.time()
        try:
            super()._welcome(stream)  # raises once the initiator has left
        finally:
            self.body.diary.visits.append(Visit(begun, time.time()))


def serve_camera(told: Connection, width: int, height: int) -> None:
    """Be the camera: tell the address, at the end the diary."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    body = WatchedBody(SimulatedCamera(width=width, height=height, format="jpeg"))
    told.send(WatchedResponder(body).address)
    told.recv()
    told.send(body.diary)


@dataclass(frozen=True)
class Verdict:
    """What became of the pairs that were asked for."""

    right: int
    lost: int
    swapped: int
    mixed: int


def judge(jobs: Sequence[dict[str, Any]], releases: Sequence[Release]) -> Verdict:
    """Tell right pairs from others: two releases in a row, no job's twice, the second with flash.

    jobs: as the service answers. A photograph that the camera never took makes a pair mixed.
    """
    by_digest = {digest: release for release in releases for digest in release.digests}
    used: set[int] = set()
    counts = {"right": 0, "lost": 0, "swapped": 0, "mixed": 0}
    for job in jobs:
        inputs = job["inputs"]
        if job["state"] != "succeeded" or not inputs:
            counts["lost"] += 1
            continue
        found = [by_digest.get(inputs[frame]["sha256"]) for frame in ("no_flash", "flash")]
        counts[_kind_of_pair(found, used)] += 1
        used |= {release.number for release in found if release}
    return Verdict(**counts)


def _kind_of_pair(found: Sequence[Release | None], used: set[int]) -> str:
    without, with_flash = found
    if without is None or with_flash is None or {without.number, with_flash.number} & used:
        return "mixed"
    if without.fired and not with_flash.fired:
        return "swapped"
    in_a_row = with_flash.number == without.number + 1
    return "right" if in_a_row and with_flash.fired and not without.fired else "mixed"


def overheads(diary: Diary) -> list[float]:
    """Tell seconds of each visit that the camera did not need itself.

    Whatever the two programs and the network do counts, that of the simulated camera too; not the
    exposure, the writing to the card, the developing of the simulated picture and the charging of
    the flash.
    """
    return [
        visit.ended - visit.begun - sum(each.own_s for each in _within(visit, diary.releases))
        for visit in diary.visits
    ]


def _within(visit: Visit, releases: Sequence[Release]) -> list[Release]:
    return [release for release in releases if visit.begun <= release.at <= visit.ended]


PARTS = (
    "camera left alone since the pair before",
    "capture: the camera's own time",
    "capture: ours",
    "from there to the job's end, beside the next pair",
)
"""Where the time of a pair goes while the next one waits already."""


def divide(
    jobs: Sequence[dict[str, Any]], diary: Diary, overhead: Sequence[float]
) -> dict[str, list[float]]:
    """Divide the time of each visit but the first into PARTS, and tell how long its job went on.

    jobs: as the service answers. A visit that gave no job its photograph has no end of a job.
    """
    finished = {
        job["inputs"]["flash"]["sha256"]: datetime.fromisoformat(job["finished"]).timestamp()
        for job in jobs
        if job["inputs"]
    }
    parts: dict[str, list[float]] = {part: [] for part in PARTS}
    alone, own, of_ours, afterwards = parts.values()
    for (before, visit), ours in zip(pairwise(diary.visits), overhead[1:], strict=True):
        alone.append(visit.begun - before.ended)
        own.append(visit.ended - visit.begun - ours)
        of_ours.append(ours)
        digests = [digest for each in _within(visit, diary.releases) for digest in each.digests]
        afterwards += [finished[digest] - visit.ended for digest in digests if digest in finished]
    return parts


def growth(samples: Sequence[float]) -> float:
    """How much more there is at the end: median of the last fifth less that of the second one.

    By then everything has been loaded once; fewer than five samples show no growth.
    """
    fifth = len(samples) // 5
    return median(samples[-fifth:]) - median(samples[fifth : 2 * fifth]) if fifth else 0.0


def quantile(values: Sequence[float], share: float) -> float:
    """Give the value that so large a share, 0…1, is not above."""
    ranked = sorted(values)
    return ranked[min(len(ranked) - 1, int(share * len(ranked)))]


@dataclass
class Session:
    """What a run of so many pairs came to. memory: MiB by role of process, over the run."""

    jobs: list[dict[str, Any]]
    diary: Diary
    memory: dict[str, list[float]]
    seconds: float


def run(pairs: int, width: int, height: int) -> Session:
    """Start a service and a camera and take that many pairs."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    camera = context.Process(target=serve_camera, args=(there, width, height), daemon=True)
    camera.start()
    address = f"ptp+ip://{here.recv()}"
    assert camera.pid is not None
    with tempfile.TemporaryDirectory(prefix="pairs-") as folder, _service(Path(folder)) as found:
        host, url = found
        begun = time.monotonic()
        memory: dict[str, list[float]] = {}
        with httpx.Client(base_url=url, timeout=_PATIENCE_S) as http:
            taking = _Taking(http, address)
            with contextlib.suppress(KeyboardInterrupt):  # what has been done counts
                for number in range(pairs):
                    taking.one(more=number + _WAITING < pairs)
                    if number % _SAMPLED == 0:
                        _look(memory, host, camera.pid)
        seconds = time.monotonic() - begun
    here.send(None)
    diary: Diary = here.recv()
    camera.join()
    return Session(taking.jobs, diary, memory, seconds)


class _Taking:
    """A client that always has the next pairs waiting."""

    def __init__(self, http: httpx.Client, address: str) -> None:
        self.jobs: list[dict[str, Any]] = []
        self._http = http
        self._body = {"capture": {"camera": address}, "options": OPTIONS}
        self._asked = [self._ask() for _ in range(_WAITING)]

    def _ask(self) -> str:
        answer = self._http.post("/jobs", json=self._body).raise_for_status()
        link: str = answer.json()["links"]["self"]
        return link

    def one(self, more: bool) -> None:
        """Wait for the pair that was asked for first; ask for another one."""
        link, deadline = self._asked[0], time.monotonic() + _PATIENCE_S
        while (job := self._http.get(link).raise_for_status().json())["state"] not in _ENDED:
            if time.monotonic() > deadline:
                sys.exit(f"a pair was waited for in vain: {job}")
            time.sleep(_LOOK_S)
        if job["error"]:
            sys.stderr.write(f"pair {len(self.jobs) + 1}: {job['error']['detail']}\n")
        self.jobs.append(job)
        del self._asked[0]
        if more:
            self._asked.append(self._ask())


@contextlib.contextmanager
def _service(folder: Path) -> Iterator[tuple[Host, str]]:
    port = free_port()
    host = Host(folder / "host", ["serve"], port=port, cameras="ptp+ip://127.0.0.1")
    url, deadline = f"http://127.0.0.1:{port}", time.monotonic() + _PATIENCE_S
    try:
        host.start()
        while not _answers(url):
            if time.monotonic() > deadline:
                sys.exit(host.log.read_text())
            time.sleep(_LOOK_S)
        yield host, url
    finally:
        host.kill()


def _answers(url: str) -> bool:
    with contextlib.suppress(httpx.HTTPError):
        return httpx.get(f"{url}/readyz").status_code == 200
    return False


def _look(memory: dict[str, list[float]], host: Host, camera: int) -> None:
    found = {each.role: each.pid for each in host.processes() if each.role != "child"}
    for role, pid in (found | {"camera": camera}).items():
        with contextlib.suppress(OSError):
            memory.setdefault(role, []).append(resident_mib(pid))


def resident_mib(pid: int) -> float:
    """Memory of a process, in MiB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
