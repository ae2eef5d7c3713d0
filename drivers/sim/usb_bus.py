"""The simulated camera on a bus of its own: pyusb's driver runs whole, only the wire is not there.

Source: USB 2.0, chapter 9; USB still image class 1.0.
"""

from __future__ import annotations

import errno
from collections import deque
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import usb.backend
import usb.core

from drivers.clock import Clock
from drivers.ptp import containers
from drivers.ptp.codes import ContainerType
from drivers.ptp.containers import Container
from drivers.sim.body import Body
from drivers.sim.responder import RELEASES, Responder

_PACKET_BYTES = 512
_OUT, _IN, _EVENTS = 0x02, 0x81, 0x83
_STRING, _GET_DESCRIPTOR = 3, 6
_CANCEL, _RESET = 0x64, 0x66  # read from the standard anew, so that they check the driver
_SHORT_BYTES = 8192  # of a piece, where everything comes in pieces
_SLOW_BYTES_PER_S = 4_000_000


@dataclass(frozen=True, eq=False)
class _Plug:
    """The camera as the bus knows it from one plugging in to the next."""

    address: int


class SimulatedBus(usb.backend.IBackend):  # type: ignore[misc]
    """A bus with one camera on it.

    held: another program has claimed its interface. event_bytes: most in a packet of events, to be
    set before the camera is found.
    """

    event_bytes = 64

    def __init__(self, body: Body, clock: Clock) -> None:
        super().__init__()
        self.body, self.held = body, False
        self._clock = clock
        self._responder = Responder(body)
        self._answers: deque[bytes] = deque()  # one per transfer
        self._event = b""  # what the host has not read of one
        self._halted = False
        self._plug = _Plug(1)

    def replug(self) -> None:
        """Plug the cable in again: the camera begins anew, at the bus's next address."""
        self._responder = Responder(self.body)
        self._answers.clear()
        self._event = b""
        self._halted = False
        self._plug = _Plug(self._plug.address + 1)

    def plug_in(self) -> None:
        """Put the cable back in, after the fault that pulls it."""
        self._responder.unplugged = False

    def enumerate_devices(self) -> Any:
        """The one device, unless its cable is pulled."""
        if not self._responder.unplugged:
            yield self._plug

    def get_parent(self, _device: Any) -> None:
        """It hangs on no hub."""

    def get_device_descriptor(self, device: Any) -> Any:
        """Who made it."""
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x0200,
            bDeviceClass=0,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=0x04B0,
            idProduct=0x0429,
            bcdDevice=0x0100,
            iManufacturer=1,
            iProduct=2,
            iSerialNumber=3,
            bNumConfigurations=1,
            address=device.address,
            bus=1,
            port_number=1,
            port_numbers=(1,),
            speed=3,
        )

    def get_configuration_descriptor(self, _device: Any, config: int) -> Any:
        """Its one configuration."""
        if config:
            raise IndexError(config)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=39,
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0xC0,
            bMaxPower=1,
            extra_descriptors=[],
        )

    def get_interface_descriptor(self, _device: Any, intf: int, alt: int, _config: int) -> Any:
        """Its one interface, for still images."""
        if intf or alt:
            raise IndexError(intf)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=3,
            bInterfaceClass=6,
            bInterfaceSubClass=1,
            bInterfaceProtocol=1,
            iInterface=0,
            extra_descriptors=[],
        )

    def get_endpoint_descriptor(
        self, _device: Any, ep: int, _intf: int, _alt: int, _config: int
    ) -> Any:
        """Bulk out, bulk in, interrupt in."""
        address, kind, size = (
            (_OUT, 2, _PACKET_BYTES),
            (_IN, 2, _PACKET_BYTES),
            (_EVENTS, 3, self.event_bytes),
        )[ep]
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=address,
            bmAttributes=kind,
            wMaxPacketSize=size,
            bInterval=4,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
        )

    def open_device(self, device: Any) -> Any:
        """Give a handle."""
        self._check_plugged(device)
        return device

    def close_device(self, _handle: Any) -> None:
        """Keep what is in the pipe: a camera does not notice that a program ends."""

    def set_configuration(self, _handle: Any, _value: int) -> None:
        """Take the only configuration."""

    def get_configuration(self, handle: Any) -> int:
        """Give the only configuration."""
        self._check_plugged(handle)
        return 1

    def claim_interface(self, _handle: Any, _intf: int) -> None:
        """Claim the interface."""
        if self.held:
            raise usb.core.USBError("Resource busy", errno=errno.EBUSY)

    def release_interface(self, _handle: Any, _intf: int) -> None:
        """Let go of the interface."""

    def is_kernel_driver_active(self, _handle: Any, _intf: int) -> bool:
        """No kernel driver wants a camera."""
        return False

    def clear_halt(self, _handle: Any, _ep: int) -> None:
        """End a stall."""
        self._halted = False

    def bulk_write(self, handle: Any, _ep: int, _intf: int, data: Any, _timeout: int) -> int:
        """Take a container from the host."""
        self._check_plugged(handle)
        raw = data.tobytes()
        if raw:
            container = containers.decode(raw)
            self._answers.extend(self._cut(self._responder.answer(container)))
            released = container.type is ContainerType.COMMAND and container.code in RELEASES
            self._halted = self.body.fault == "stall" and released
        return len(raw)

    def _cut(self, answers: list[Container]) -> list[bytes]:
        """Cut answers into transfers, each of which ends with a short packet."""
        raw = [answer.encode() for answer in answers]
        if self.body.fault == "glued_packets":
            return [b"".join(raw)]
        if self.body.fault != "short_packets":
            return raw
        pieces = [b""]  # and an empty packet before everything
        for each in raw:
            pieces += [each[:5], each[5:12]]
            pieces += [each[at : at + _SHORT_BYTES] for at in range(12, len(each), _SHORT_BYTES)]
        return [pieces[0], *filter(None, pieces)]

    def bulk_read(self, handle: Any, _ep: int, _intf: int, buffer: Any, timeout: int) -> int:
        """Hand the host what fits of the next transfer."""
        self._check_plugged(handle)
        if self._halted:
            raise usb.core.USBError("Pipe error", errno=errno.EPIPE)
        if not self._answers:
            self._wait(timeout)
        raw = self._answers.popleft()
        count = min(len(raw), len(buffer))
        memoryview(buffer)[:count] = raw[:count]
        if len(raw) > count:
            self._answers.appendleft(raw[count:])
        if self.body.fault == "slow_link":
            self._clock.sleep(count / _SLOW_BYTES_PER_S)
        return count

    def intr_read(self, handle: Any, _ep: int, _intf: int, buffer: Any, timeout: int) -> int:
        """Hand the host the next packet of an event."""
        self._check_plugged(handle)
        self._event = self._event or self._next_event(timeout)
        raw, self._event = self._event[: self.event_bytes], self._event[self.event_bytes :]
        memoryview(buffer)[: len(raw)] = raw
        return len(raw)

    def _next_event(self, timeout: int) -> bytes:
        raw = self._responder.next_event()
        if raw is None:
            wait = self.body.seconds_to_wait()
            if wait is None or 1000 * wait > timeout:
                self._wait(timeout)
            self._clock.sleep(wait or 0)
            raw = self._responder.next_event()
        if raw is None:
            self._wait(timeout)
        return raw or b""

    def _wait(self, timeout_ms: int) -> None:
        self._clock.sleep(timeout_ms / 1000)
        raise usb.core.USBTimeoutError("Operation timed out", errno=errno.ETIMEDOUT)

    def ctrl_transfer(
        self,
        handle: Any,
        _type: int,
        request: int,
        value: int,
        _index: int,
        data: Any,
        _timeout: int,
    ) -> int:
        """Answer requests for strings, and the three of the class."""
        self._check_plugged(handle)
        if request == _GET_DESCRIPTOR and value >> 8 == _STRING:
            raw = self._string(value & 0xFF)[: len(data)]
            memoryview(data)[: len(raw)] = raw
            return len(raw)
        if request in (_CANCEL, _RESET):
            self._answers.clear()
            self._halted = False
            return len(data)
        raise usb.core.USBError("Pipe error", errno=errno.EPIPE)

    def _string(self, index: int) -> bytes:
        model = self.body.model
        texts = ("\u0409", model.make, model.model, model.serial)
        raw = texts[index].encode("utf-16-le")
        return bytes((len(raw) + 2, _STRING)) + raw

    def _check_plugged(self, plug: _Plug) -> None:
        if self._responder.unplugged or plug is not self._plug:
            raise usb.core.USBError("No such device", errno=errno.ENODEV)
