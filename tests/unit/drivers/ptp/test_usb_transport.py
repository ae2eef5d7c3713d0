from __future__ import annotations

import errno
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import usb.core

from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import (
    CameraBusyError,
    CameraDisconnectedError,
    CameraNotFoundError,
    CameraTimeoutError,
    ProtocolError,
)
from drivers.ptp import usb as driver
from drivers.ptp import usb_transport
from drivers.ptp.camera import open_awake
from drivers.ptp.codes import ContainerType, Operation
from drivers.ptp.containers import Container
from drivers.ptp.session import Session
from drivers.ptp.usb_transport import UsbTransport
from drivers.sim.address import SimulatedCamera
from drivers.sim.body import Body
from drivers.sim.usb_bus import SimulatedBus

COMMAND = Container.with_parameters(ContainerType.COMMAND, Operation.OPEN_SESSION, 0, (1,))
OK = Container(ContainerType.RESPONSE, 0x2001, 0).encode()


class ScriptedBus(SimulatedBus):
    """Sends these transfers, whatever is asked."""

    def __init__(self, clock: Clock, *transfers: bytes) -> None:
        super().__init__(Body(SimulatedCamera(width=64, height=64), clock), clock)
        self.transfers = transfers
        self.written: list[bytes] = []
        self.requests: list[int] = []

    def ctrl_transfer(self, handle: Any, kind: int, request: int, *rest: Any) -> int:
        self.requests.append(request)
        return super().ctrl_transfer(handle, kind, request, *rest)

    def bulk_write(self, _handle: Any, _ep: int, _intf: int, data: Any, _timeout: int) -> int:
        self.written.append(data.tobytes())
        if data:
            self._answers.extend(self.transfers)
        return len(data)


def asked(bus: SimulatedBus, clock: Clock) -> UsbTransport:
    transport = driver.connect("", bus, clock)
    transport.send(COMMAND)
    return transport


def test_an_interface_held_by_another_program_is_said(bus: SimulatedBus, clock: Clock) -> None:
    bus.held = True
    with pytest.raises(CameraBusyError, match="in use by another program: close"):
        driver.connect("", bus, clock)


class Programs:
    """/proc, with one program that holds the camera, and one that ends while they are listed."""

    def __init__(self, folder: Path, name: bytes) -> None:
        self.link = folder / "7" / "fd" / "3"
        self.link.parent.mkdir(parents=True)
        self.link.symlink_to("/dev/bus/usb/001/001")
        (folder / "7" / "comm").write_bytes(name)

    def glob(self, _pattern: str) -> Iterator[Path]:
        yield self.link
        raise ProcessLookupError(errno.ESRCH, "No such process")


@pytest.mark.parametrize(
    ("comm", "name"),
    [
        (b"gvfsd\n", "gvfsd"),
        ("Dunkelkammer-fü\n".encode()[:15] + b"\n", "Dunkelkammer-f\ufffd"),
        (b"\x1b[2Jgvfsd\n", r"\[2Jgvfsd"),
    ],
)
def test_the_program_that_holds_the_interface_is_named(
    bus: SimulatedBus,
    clock: Clock,
    comm: bytes,
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(usb_transport, "Path", lambda _: Programs(tmp_path, comm))
    bus.held = True
    with pytest.raises(CameraBusyError, match=f"in use by {name}: close"):
        driver.connect("", bus, clock)


@pytest.mark.parametrize(
    "transfers",
    [
        (OK,),
        (b"", OK),  # one empty packet first
        (OK[:5], OK[5:]),
        (OK[:4] + OK[4:],),
    ],
)
def test_answers_are_put_together(clock: Clock, transfers: tuple[bytes, ...]) -> None:
    answer = asked(ScriptedBus(clock, *transfers), clock).receive()
    assert (answer.type, answer.code, answer.transaction) == (ContainerType.RESPONSE, 0x2001, 0)


def test_data_of_unknown_length_end_with_a_short_packet(clock: Clock) -> None:
    data = bytearray(Container(ContainerType.DATA, 0x1009, 0, bytes(1000)).encode())
    data[:4] = b"\xff" * 4
    transport = asked(ScriptedBus(clock, bytes(data[:512]), bytes(data[512:]), OK), clock)
    assert len(transport.receive().payload) == 1000
    assert transport.receive().code == 0x2001


def test_data_of_unknown_length_that_go_on_beyond_what_may_be_are_refused(clock: Clock) -> None:
    """Before a camera that never stops has filled the memory."""
    bus = ScriptedBus(clock, b"\xff" * 4 + bytes(508), *[bytes(512)] * 9)
    with pytest.raises(ProtocolError, match="wants to send 1024 bytes where 1000 may be"):
        asked(bus, clock).receive(1000)
    assert bus.requests[-1] == 0x66  # to be reset


def test_data_and_response_may_come_in_one_transfer(clock: Clock) -> None:
    data = Container(ContainerType.DATA, 0x1009, 0, b"photograph").encode()
    transport = asked(ScriptedBus(clock, data + OK), clock)
    assert transport.receive().payload == b"photograph"
    assert transport.receive().code == 0x2001


@pytest.mark.parametrize("length", [0, 11, 2**20 + 13, 0xFFFFFFFE])
def test_lengths_that_cannot_be_are_refused(clock: Clock, length: int) -> None:
    bus = ScriptedBus(clock, length.to_bytes(4, "little") + OK[4:])
    with pytest.raises(ProtocolError, match=f"wants to send {length} bytes"):
        asked(bus, clock).receive()
    assert bus.requests[-1] == 0x66  # to be reset


def test_what_is_left_of_an_answer_is_none_of_the_next(clock: Clock) -> None:
    transport = asked(ScriptedBus(clock, OK + b"rest"), clock)
    assert transport.receive().code == 0x2001
    transport.send(COMMAND)
    assert transport.receive().code == 0x2001


def test_data_that_fill_packets_are_followed_by_an_empty_one(clock: Clock) -> None:
    bus = ScriptedBus(clock)
    transport = asked(bus, clock)
    transport.send(Container(ContainerType.DATA, 0x1016, 0, bytes(500)))
    transport.send(Container(ContainerType.DATA, 0x1016, 0, bytes(501)))
    assert [len(raw) for raw in bus.written] == [16, 512, 0, 513]


@pytest.mark.parametrize("sent", [(), ((1 << 24).to_bytes(4, "little") + bytes(508),)])
def test_silence_ends_at_the_deadline(clock: Clock, sent: tuple[bytes, ...]) -> None:
    bus = ScriptedBus(clock, *sent)
    transport = asked(bus, clock)
    with pytest.raises(CameraTimeoutError, match="no answer for 10 s"):
        transport.receive(1 << 24)
    assert bus.requests[-1] == 0x64  # to be cancelled
    assert clock.monotonic() == pytest.approx(10, abs=0.1)


class DrippingBus(ScriptedBus):
    """Sends a container of 1 MiB in pieces, at this speed; looked: how long for each, in ms."""

    def __init__(self, clock: Clock, bytes_per_s: float) -> None:
        raw = Container(ContainerType.DATA, 0x101B, 0, bytes(1 << 20)).encode()
        pieces = [raw[at : at + 16384] for at in range(0, len(raw), 16384)]
        super().__init__(clock, *pieces)
        self.bytes_per_s = bytes_per_s

    def bulk_read(self, *how: Any) -> int:
        count = super().bulk_read(*how)
        self._clock.sleep(count / self.bytes_per_s)
        return count


@pytest.mark.parametrize("room", [None, 1 << 20])
def test_data_have_time_by_what_was_asked_for(clock: Clock, room: int | None) -> None:
    """And not by how much more may come: 10 s, and 50 kB/s."""
    into = None if room is None else memoryview(bytearray(room))
    most = (room or 1 << 19) * 2
    answer = asked(DrippingBus(clock, 36_000), clock).receive(most, into)
    assert len(answer.payload) == 1 << 20
    with pytest.raises(CameraTimeoutError):
        asked(DrippingBus(clock, 32_000), clock).receive(most, into)


class SilentBus(ScriptedBus):
    """Notes how long is looked for what comes, in milliseconds."""

    def __init__(self, clock: Clock, *transfers: bytes) -> None:
        super().__init__(clock, *transfers)
        self.looks: list[int] = []

    def bulk_read(self, handle: Any, ep: int, intf: int, buffer: Any, timeout: int) -> int:
        self.looks.append(timeout)
        return super().bulk_read(handle, ep, intf, buffer, timeout)


def test_a_long_wait_for_an_answer_is_of_short_looks(clock: Clock) -> None:
    """While libusb looks, Python handles no Ctrl-C."""
    bus = SilentBus(clock)
    with pytest.raises(CameraTimeoutError, match="no answer for 10 s"):
        asked(bus, clock).receive()
    assert bus.looks == [500] * 20


def test_an_answer_that_comes_late_is_taken(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    bus = SilentBus(clock)
    transport = asked(bus, clock)
    sleep = clock.sleep

    def answer_at_last(seconds: float) -> None:
        sleep(seconds)
        if clock.monotonic() >= 9:
            bus._answers.append(OK)

    monkeypatch.setattr(clock, "sleep", answer_at_last)
    assert transport.receive().code == 0x2001
    assert bus.looks == [500] * 19


def test_a_silent_camera_has_a_second_to_close_its_session(clock: Clock) -> None:
    bus = SilentBus(clock, OK)
    session = Session(driver.connect("", bus, clock), clock)
    session.open()
    bus.transfers = ()
    with pytest.raises(CameraTimeoutError):
        session.request(Operation.GET_STORAGE_IDS)
    bus.looks.clear()
    session.close()
    assert bus.written[-1][6:8] == b"\x03\x10"
    assert bus.looks == [100, 500, 500]  # for what is in the pipe, and for the answer


def test_a_camera_is_reset_before_its_pipe_is_read_empty(clock: Clock) -> None:
    """Or all that is left of a photograph would be waited for."""
    bus = SilentBus(clock)
    transport = driver.connect("", bus, clock)
    bus._answers.extend([bytes(512)] * 5)
    transport.start_afresh()
    assert (bus.requests[0], bus.looks) == (0x66, [100])


def test_a_stall_is_cleared_once(clock: Clock) -> None:
    bus = ScriptedBus(clock, OK)
    transport = asked(bus, clock)
    bus._halted = True
    assert transport.receive().code == 0x2001


def test_an_endpoint_that_stays_stalled_is_given_up(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = ScriptedBus(clock, OK)
    transport = asked(bus, clock)
    bus._halted = True
    monkeypatch.setattr(bus, "clear_halt", lambda *_: None)
    with pytest.raises(CameraDisconnectedError, match="plug it in again"):
        transport.receive()


@pytest.mark.parametrize(
    ("number", "error", "sentence"),
    [
        (errno.EACCES, CameraNotFoundError, "udev rule"),
        (errno.EBUSY, CameraBusyError, "in use"),
        (errno.EIO, CameraDisconnectedError, "plug it in again"),
    ],
)
def test_errors_of_usb_become_those_of_cameras(
    bus: SimulatedBus,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
    number: int,
    error: type[Exception],
    sentence: str,
) -> None:
    def claim(*_: object) -> None:
        raise usb.core.USBError("no", errno=number)

    monkeypatch.setattr(bus, "claim_interface", claim)
    with pytest.raises(error, match=sentence):
        driver.connect("", bus, clock)


@pytest.mark.parametrize(
    ("number", "error"),
    [(errno.ETIMEDOUT, CameraTimeoutError), (errno.EPIPE, CameraDisconnectedError)],
)
def test_a_camera_that_does_not_tell_its_configuration_is_told_as_such(
    bus: SimulatedBus,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
    number: int,
    error: type[Exception],
) -> None:
    """As one that hangs, before its interface is known."""
    kind = usb.core.USBTimeoutError if number == errno.ETIMEDOUT else usb.core.USBError

    def fail(*_: Any) -> None:
        raise kind("no", errno=number)

    monkeypatch.setattr(bus, "get_configuration", fail)
    monkeypatch.setattr(bus, "set_configuration", fail)
    with pytest.raises(error):
        driver.connect("", bus, clock)


def test_a_camera_set_to_a_configuration_without_photographs_is_refused(
    bus: SimulatedBus, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    devices = driver.find_cameras(bus)
    monkeypatch.setattr(driver, "find_cameras", lambda _backend: devices)
    monkeypatch.setattr(usb_transport, "is_still_image", lambda _interface: False)
    with pytest.raises(ProtocolError, match="no interface for photographs"):
        driver.connect("", bus, clock)


def test_a_pair_comes_from_a_camera_that_tells_events_in_small_packets(
    bus: SimulatedBus, clock: Clock
) -> None:
    bus.event_bytes = 8
    with open_awake("ptp+usb://", lambda: driver.connect("", bus, clock), clock) as camera:
        pair = capture_pair(camera, clock=clock)
    assert [shot.exposure.flash_fired for shot in (pair.no_flash, pair.flash)] == [False, True]


def test_nothing_is_asked_of_a_closed_camera(bus: SimulatedBus, clock: Clock) -> None:
    transport = driver.connect("", bus, clock)
    transport.close()
    transport.close()
    with pytest.raises(CameraDisconnectedError):
        transport.receive_event(0)
