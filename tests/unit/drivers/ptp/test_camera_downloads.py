"""Photographs that a camera describes and sends, whole or in parts."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.clock import Clock
from drivers.errors import (
    TransferError,
)
from drivers.ptp.codes import Operation
from drivers.ptp.containers import Container
from drivers.ptp.datasets import DeviceInfo
from drivers.ptp.transport import DATASET_BYTES
from drivers.shot import fetch
from tests.unit.drivers.ptp.tampered import Tamper, photographed


def test_photographs_are_described_and_downloaded(clock: Clock) -> None:
    camera = photographed(clock)
    described = {item.kind: item for item in map(camera.describe, camera.objects())}
    assert set(described) == {"folder", "dng", "jpeg"}
    dng = described["dng"]
    whole = b"".join(camera.download(dng.handle))
    assert len(whole) == dng.size
    assert (dng.name, dng.storage) == ("DSC_0001.DNG", "0x00010001")
    assert whole[:4] == b"II*\0"
    assert b"".join(camera.download(dng.handle, 1000)) == whole[1000:]
    assert b"".join(camera.download(dng.handle, dng.size)) == b""


def test_downloads_come_in_chunks(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    camera = photographed(clock)
    whole = b"".join(camera.download(2))
    monkeypatch.setattr("drivers.ptp.camera.CHUNK_BYTES", 1000)
    chunks = list(camera.download(2))
    assert [len(chunk) for chunk in chunks[:3]] == [1000, 2000, 4000]  # as it is quick
    assert b"".join(chunks) == whole


def test_chunks_are_smaller_after_one_that_took_long(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    takes_s = iter([0, 0, 3, 1, 3, 3])

    def slow(data: bytes) -> bytes:
        clock.sleep(next(takes_s, 0))
        return data

    camera = photographed(clock, {Operation.GET_PARTIAL_OBJECT: slow})
    monkeypatch.setattr("drivers.ptp.camera.CHUNK_BYTES", 100)
    chunks = [len(chunk) for chunk in camera.download(2)]
    assert chunks[:8] == [100, 200, 400, 200, 200, 100, 100, 200]


@pytest.mark.parametrize("room", [None, True])
def test_a_chunk_has_room_for_what_is_asked_for(
    clock: Clock, room: bool | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By which the time that it may take is known."""
    camera = photographed(clock)
    size, rooms = camera.describe(2).size, list[tuple[int, int]]()
    receive = camera._session.transport.receive

    def noting(most: int = DATASET_BYTES, into: memoryview | None = None) -> Container:
        if into is not None:
            rooms.append((most, len(into)))
        return receive(most, into)

    monkeypatch.setattr(camera._session.transport, "receive", noting)
    list(camera.download(2, into=memoryview(bytearray(size)) if room else None))
    assert rooms == [(2 << 20, size)]


@pytest.mark.parametrize("tamper", [lambda _: b"", lambda data: data + b"!"])
def test_chunks_of_a_wrong_length_are_refused(clock: Clock, tamper: Tamper) -> None:
    camera = photographed(clock, {Operation.GET_PARTIAL_OBJECT: tamper})
    with pytest.raises(TransferError, match="bytes where"):
        list(camera.download(2))


def test_short_chunks_are_put_together(clock: Clock) -> None:
    camera = photographed(clock, {Operation.GET_PARTIAL_OBJECT: lambda data: data[:700]})
    assert len(b"".join(camera.download(2))) == camera.describe(2).size


def without_parts(data: bytes) -> bytes:
    info = DeviceInfo.decode(data)
    others = tuple(code for code in info.operations if code != Operation.GET_PARTIAL_OBJECT)
    return replace(info, operations=others).encode()


def test_a_camera_that_sends_no_parts_sends_a_photograph_whole(clock: Clock) -> None:
    camera = photographed(clock, {Operation.GET_DEVICE_INFO: without_parts})
    into = memoryview(bytearray(camera.describe(2).size))
    (photograph,) = camera.download(2, into=into)
    assert bytes(photograph) == bytes(into)
    assert bytes(into[:4]) == b"II*\0"
    (rest,) = camera.download(2, 1000)
    assert bytes(rest) == bytes(into)[1000:]


def test_a_photograph_that_comes_short_as_a_whole_is_asked_for_again(clock: Clock) -> None:
    answers = [lambda data: data[:-1], lambda data: data]
    tampers: dict[int, Tamper] = {
        Operation.GET_DEVICE_INFO: without_parts,
        Operation.GET_OBJECT: lambda data: answers.pop(0)(data),
    }
    camera = photographed(clock, tampers)
    item = camera.describe(2)
    assert len(fetch(camera, item)) == item.size
    assert answers == []
