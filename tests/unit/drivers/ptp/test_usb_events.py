"""Events of cameras on USB."""

from __future__ import annotations

import errno
from collections import deque
from typing import Any

import pytest
import usb.core

from drivers.clock import Clock
from drivers.errors import ProtocolError
from drivers.ptp import containers
from drivers.ptp import usb as driver
from drivers.ptp.codes import ContainerType
from drivers.ptp.containers import Container
from drivers.sim.address import SimulatedCamera
from drivers.sim.body import Body
from drivers.sim.usb_bus import SimulatedBus


class TellingBus(SimulatedBus):
    """Tells these packets of events; an empty one stands for a time without any."""

    def __init__(self, clock: Clock, *packets: bytes) -> None:
        super().__init__(Body(SimulatedCamera(width=64, height=64), clock), clock)
        self.packets = deque(packets)
        self.waited: list[int] = []

    def intr_read(self, _handle: Any, _ep: int, _intf: int, buffer: Any, timeout: int) -> int:
        self.waited.append(timeout)
        packet = self.packets.popleft() if self.packets else b""
        if not packet:
            raise usb.core.USBTimeoutError("Operation timed out", errno=errno.ETIMEDOUT)
        memoryview(buffer)[: len(packet)] = packet
        return len(packet)


ADDED = Container.with_parameters(ContainerType.EVENT, 0x4002, 0, (9, 8, 7)).encode()
COMPLETE = Container(ContainerType.EVENT, 0x400D, 0).encode()


def test_events_are_put_together_from_small_packets(clock: Clock) -> None:
    packets = (ADDED[:8], ADDED[8:16], ADDED[16:], COMPLETE[:8], COMPLETE[8:])
    bus = TellingBus(clock, *packets)
    transport = driver.connect("", bus, clock)
    added = transport.receive_event(0.25)
    assert added is not None
    assert (added.code, added.parameters) == (0x4002, (9, 8, 7))
    complete = transport.receive_event(0)
    assert complete is not None
    assert (complete.code, complete.parameters) == (0x400D, ())
    assert transport.receive_event(0) is None
    assert bus.waited == [250, 100, 100, 10, 100, 10]


def test_a_long_wait_for_an_event_is_of_short_looks(clock: Clock) -> None:
    """While libusb looks, Python handles no Ctrl-C."""
    bus = TellingBus(clock, b"", b"", COMPLETE, b"", ADDED[:8], ADDED[8:])
    transport = driver.connect("", bus, clock)
    complete, added = (transport.receive_event(1.2) for _ in range(2))
    assert (complete, added) == (containers.decode(COMPLETE), containers.decode(ADDED))
    assert bus.waited == [500, 500, 200, 500, 500, 100]
    bus.waited.clear()
    assert transport.receive_event(1.2) is None
    assert bus.waited == [500, 500, 200]


def test_an_event_that_comes_with_a_pause_is_whole_in_the_end(clock: Clock) -> None:
    transport = driver.connect("", TellingBus(clock, ADDED[:8], b"", ADDED[8:]), clock)
    assert transport.receive_event(0) is None
    added = transport.receive_event(0)
    assert added is not None
    assert added.parameters == (9, 8, 7)


def test_a_stall_before_an_event_is_cleared(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    bus = TellingBus(clock, ADDED)
    cleared, read = list[int](), bus.intr_read

    def halted(*arguments: Any) -> int:
        if not cleared:
            raise usb.core.USBError("Pipe error", errno=errno.EPIPE)
        return read(*arguments)

    monkeypatch.setattr(bus, "intr_read", halted)
    monkeypatch.setattr(bus, "clear_halt", lambda _handle, endpoint: cleared.append(endpoint))
    added = driver.connect("", bus, clock).receive_event(0)
    assert added is not None
    assert (added.code, added.parameters, cleared) == (0x4002, (9, 8, 7), [0x83])


@pytest.mark.parametrize("event", [b"\x21\0\0\0" + ADDED[4:8], ADDED + b"\0", b"\7" + ADDED[1:]])
def test_after_an_event_that_cannot_be_the_next_one_is_taken(clock: Clock, event: bytes) -> None:
    transport = driver.connect("", TellingBus(clock, event, COMPLETE), clock)
    with pytest.raises(ProtocolError, match="A PTP container"):
        transport.receive_event(0)
    complete = transport.receive_event(0)
    assert complete is not None
    assert complete.code == 0x400D
