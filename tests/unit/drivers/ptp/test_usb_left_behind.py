"""What a program that was stopped leaves in the pipe of a camera on USB."""

from __future__ import annotations

import errno
from typing import Any

import pytest
import usb.core

from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.ptp import usb as driver
from drivers.ptp.camera import PtpCamera, open_awake
from drivers.ptp.codes import ContainerType, Operation
from drivers.ptp.containers import Container
from drivers.sim.usb_bus import SimulatedBus

COMMAND = Container.with_parameters(ContainerType.COMMAND, Operation.OPEN_SESSION, 0, (1,))


def opened(bus: SimulatedBus, clock: Clock) -> PtpCamera:
    return open_awake("ptp+usb://", lambda: driver.connect("", bus, clock), clock)


def ask_and_be_killed(bus: SimulatedBus, clock: Clock, operation: Operation, *asked: int) -> None:
    """Send a command as a program that does not live to take its answer."""
    session = opened(bus, clock)._session
    session.request(Operation.GET_STORAGE_IDS)
    command = Container.with_parameters(ContainerType.COMMAND, operation, 3, asked)
    session.transport.send(command)
    session.transport.close()


def no_class_requests(bus: SimulatedBus, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the camera refuse to be reset."""

    def refuse(*_: Any) -> int:
        raise usb.core.USBError("Pipe error", errno=errno.EPIPE)

    monkeypatch.setattr(bus, "ctrl_transfer", refuse)


@pytest.mark.parametrize("knows_reset", [True, False])
def test_an_answer_left_in_the_pipe_keeps_nobody_out(
    bus: SimulatedBus, clock: Clock, knows_reset: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a program leaves it that is killed between a command and its answer."""
    ask_and_be_killed(bus, clock, Operation.GET_STORAGE_IDS)
    assert len(bus._answers) == 2
    if not knows_reset:
        no_class_requests(bus, monkeypatch)
    with opened(bus, clock) as camera:
        assert camera.objects() == {1}
    assert not bus._answers


@pytest.mark.parametrize("knows_reset", [True, False])
@pytest.mark.parametrize("begins", [b"", b"\0\2\0\0"])
def test_half_a_photograph_left_in_the_pipe_keeps_nobody_out(
    bus: SimulatedBus,
    clock: Clock,
    begins: bytes,
    knows_reset: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever length its next bytes stand for, taken as the head of an answer."""
    with opened(bus, clock) as camera:
        pair = capture_pair(camera, clock=clock)
    handle = pair.flash.stored[0].handle
    ask_and_be_killed(bus, clock, Operation.GET_PARTIAL_OBJECT, handle, 0, 1 << 20)
    bus._answers[0] = begins + bus._answers[0][512:]
    if not knows_reset:
        no_class_requests(bus, monkeypatch)
    with opened(bus, clock) as camera:
        assert b"".join(camera.download(handle)) == pair.flash.files["jpeg"]


def test_a_session_opened_by_an_old_answer_is_opened_anew(bus: SimulatedBus, clock: Clock) -> None:
    """The answer to another opening says yes, and every answer after it is one too old."""
    transport = driver.connect("", bus, clock)
    transport.send(COMMAND)
    transport.close()
    with opened(bus, clock) as camera:
        assert camera.objects() == {1}


def test_a_program_that_is_interrupted_leaves_no_answer_behind(
    bus: SimulatedBus, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = opened(bus, clock)
    transport = camera._session.transport
    receive = transport.receive

    def interrupted() -> None:
        receive()  # the data; the response stays
        monkeypatch.setattr(transport, "receive", receive)
        raise KeyboardInterrupt

    monkeypatch.setattr(transport, "receive", lambda *_: interrupted())
    with pytest.raises(KeyboardInterrupt), camera:
        camera.objects()
    assert not bus._answers
    assert bus._responder._session is None
    PtpCamera("ptp+usb://", driver.connect("", bus, clock), clock).close()


def test_a_camera_that_never_stops_sending_is_left_alone(
    bus: SimulatedBus, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    reads = []

    def read_on(*_: Any) -> int:
        reads.append(512)
        return 512

    monkeypatch.setattr(bus, "bulk_read", read_on)
    transport = driver.connect("", bus, clock)
    transport.start_afresh()
    assert (len(reads), len(transport._received)) == (600, 512)
