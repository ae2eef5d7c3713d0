"""How fast and how steady tethered capture is: python -m tests.tether.bench object|pairs.

object: a photograph of 50 MB over PTP/IP, beside it the same bytes over a bare socket, also from
another process. pairs: many in a row through a service; see tests.tether.session.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import socket
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection

import drivers
from drivers.clock import SystemClock
from drivers.ptp.codes import ObjectFormat
from drivers.ptp.datasets import ObjectInfo
from drivers.shot import fetch
from drivers.sim.address import SimulatedCamera
from drivers.sim.body import FOLDER, STORAGE, Body, StoredObject
from drivers.sim.ip_responder import IpResponder
from tests.tether import session

SIZE = 50_000_000


def serve_camera(told: Connection) -> None:
    """Be a camera with one large photograph."""
    body = Body(SimulatedCamera(width=64, height=64), SystemClock())
    info = ObjectInfo(STORAGE, ObjectFormat.DNG, SIZE, 0, 0, FOLDER, "DSC_0001.DNG", "")
    body.objects[2] = StoredObject(info, bytes(SIZE))
    told.send(IpResponder(body).address)
    with contextlib.suppress(EOFError):  # until the other end is gone
        told.recv()


def serve_bytes(told: Connection) -> None:
    """Send the same number of bytes to whoever connects and asks."""
    data = bytes(SIZE)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        told.send(listener.getsockname())
        while True:
            connection, _ = listener.accept()
            with connection:
                connection.recv(1)
                connection.sendall(data)


@dataclass(frozen=True)
class Copy:
    """A copy of the bytes into this process. cpu_s: of this process alone."""

    wall_s: float
    cpu_s: float


def from_camera(address: str) -> Copy:
    """Fetch the photograph as a capture does, from the first question to the last byte."""
    with drivers.open_camera(f"ptp+ip://{address}") as camera:
        started = time.perf_counter(), time.process_time()
        photograph = fetch(camera, camera.describe(2))
        ended = time.perf_counter(), time.process_time()
    assert len(photograph) == SIZE
    return Copy(ended[0] - started[0], ended[1] - started[1])


def from_socket(place: tuple[str, int]) -> Copy:
    """Copy the bytes into room of just their size: nothing is faster."""
    with socket.create_connection(place) as wire:
        started = time.perf_counter(), time.process_time()
        view = memoryview(bytearray(SIZE))
        wire.sendall(b"?")
        while count := wire.recv_into(view):
            view = view[count:]
        ended = time.perf_counter(), time.process_time()
    assert not view
    return Copy(ended[0] - started[0], ended[1] - started[1])


def shares(ours: Sequence[float], bare: Sequence[float]) -> tuple[float, float]:
    """Tell our speed by that of a bare copy: of the fastest ones, and of the median ones."""
    return min(bare) / min(ours), statistics.median(bare) / statistics.median(ours)


def measure_object(rounds: int) -> None:
    """Print what a copy takes, and the share."""
    context = multiprocessing.get_context("spawn")
    places, pipes = [], []
    for serve in (serve_camera, serve_bytes):
        here, there = context.Pipe()
        pipes.append(here)  # once it is closed the camera ends
        context.Process(target=serve, args=(there,), daemon=True).start()
        places.append(here.recv())
    camera, bare = [], []
    for _ in range(rounds):  # in turn, so that both meet the same machine
        camera.append(from_camera(places[0]))
        bare.append(from_socket(places[1]))
    _say("| s for 50 MB | PTP/IP: best | median | bare: best | median | % of best | of median |")
    _say("|---|---:|---:|---:|---:|---:|---:|")
    for name, ours, theirs in (
        ("wall", [each.wall_s for each in camera], [each.wall_s for each in bare]),
        ("processor", [each.cpu_s for each in camera], [each.cpu_s for each in bare]),
    ):
        figures = min(ours), statistics.median(ours), min(theirs), statistics.median(theirs)
        shown = " | ".join(f"{seconds:.3f}" for seconds in figures)
        best, typical = shares(ours, theirs)
        _say(f"| {name} | {shown} | {100 * best:.0f} | {100 * typical:.0f} |")


def measure_pairs(pairs: int, width: int, height: int) -> None:
    """Print what became of the pairs, where their time went and what the processes held."""
    day = session.run(pairs, width, height)
    verdict = session.judge(day.jobs, day.diary.releases)
    _say(f"{len(day.jobs)} pairs of {width} × {height} in {day.seconds:.0f} s: {verdict}")
    overhead = session.overheads(day.diary)
    _say(f"releases {len(day.diary.releases)}, visits {len(overhead)}")
    _say("| part of a pair, s | median | 99 % | worst |")
    _say("|---|---:|---:|---:|")
    for part, seconds in session.divide(day.jobs, day.diary, overhead).items():
        worst = session.quantile(seconds, 0.99), max(seconds)
        _say(f"| {part} | {statistics.median(seconds):.3f} | {worst[0]:.3f} | {worst[1]:.3f} |")
    _say("| process | MiB, early | most | growth |")
    _say("|---|---:|---:|---:|")
    for role, held in day.memory.items():
        early = statistics.median(held[: max(1, len(held) // 5)])
        _say(f"| {role} | {early:.0f} | {max(held):.0f} | {session.growth(held):+.1f} |")


def main() -> None:
    """Measure what the command line says."""
    parser = argparse.ArgumentParser(prog="python -m tests.tether.bench", allow_abbrev=False)
    commands = parser.add_subparsers(dest="what", required=True)
    of_object = commands.add_parser("object")
    of_object.add_argument("--rounds", type=int, default=60)
    of_pairs = commands.add_parser("pairs")
    of_pairs.add_argument("--pairs", type=int, default=1000)
    of_pairs.add_argument("--width", type=int, default=96)
    of_pairs.add_argument("--height", type=int, default=64)
    asked = parser.parse_args()
    if asked.what == "object":
        measure_object(asked.rounds)
    else:
        measure_pairs(asked.pairs, asked.width, asked.height)


def _say(line: str) -> None:
    print(line, flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
