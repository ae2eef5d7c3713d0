"""How fast a photograph of 50 MB comes over PTP/IP: python -m tests.tether_bench.

Beside it the same bytes over a bare socket, also from another process.
"""

from __future__ import annotations

import multiprocessing
import socket
import statistics
import time
from multiprocessing.connection import Connection

import drivers
from drivers.clock import SystemClock
from drivers.ptp.codes import ObjectFormat
from drivers.ptp.datasets import ObjectInfo
from drivers.sim.address import SimulatedCamera
from drivers.sim.body import FOLDER, STORAGE, Body, StoredObject
from drivers.sim.ip_responder import IpResponder

SIZE = 50_000_000
ROUNDS = 15


def _serve_camera(told: Connection) -> None:
    body = Body(SimulatedCamera(width=64, height=64), SystemClock())
    info = ObjectInfo(STORAGE, ObjectFormat.DNG, SIZE, 0, 0, FOLDER, "DSC_0001.DNG", "")
    body.objects[2] = StoredObject(info, bytes(SIZE))
    told.send(IpResponder(body).address)
    told.recv()


def _serve_bytes(told: Connection) -> None:
    data = bytes(SIZE)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        told.send(listener.getsockname())
        for _ in range(ROUNDS):
            connection, _ = listener.accept()
            with connection:
                connection.sendall(data)
        told.recv()


def _from_camera(address: str) -> float:
    with drivers.open_camera(f"ptp+ip://{address}") as camera:
        started, received = time.perf_counter(), bytearray()
        for chunk in camera.download(2):
            received += chunk
        assert len(received) == SIZE
        return time.perf_counter() - started


def _from_socket(place: tuple[str, int]) -> float:
    with socket.create_connection(place) as wire:
        started, received = time.perf_counter(), bytearray()
        while part := wire.recv(1 << 20):
            received += part
        assert len(received) == SIZE
        return time.perf_counter() - started


def main() -> None:
    context = multiprocessing.get_context("spawn")
    ends = []
    for serve in (_serve_camera, _serve_bytes):
        here, there = context.Pipe()
        context.Process(target=serve, args=(there,), daemon=True).start()
        ends.append((here, here.recv()))
    camera, bare = [], []
    for _ in range(ROUNDS):  # in turn, so that both meet the same machine
        camera.append(_from_camera(ends[0][1]))
        bare.append(_from_socket(ends[1][1]))
    for here, _ in ends:
        here.send(None)
    rates = [SIZE / 1e6 / statistics.median(times) for times in (camera, bare)]
    share = 100 * rates[0] / rates[1]
    print(f"PTP/IP {rates[0]:.0f} MB/s, bare socket {rates[1]:.0f} MB/s: {share:.0f} %")  # noqa: T201


if __name__ == "__main__":
    main()
