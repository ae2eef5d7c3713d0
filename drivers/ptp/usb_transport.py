"""PTP over USB, class 6/1/1, through pyusb.

Source: ISO 15740, annex D; USB still image class 1.0.
"""

from __future__ import annotations

import contextlib
import errno
import struct
from array import array
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import usb.core
import usb.util

from drivers.clock import Clock
from drivers.errors import (
    CameraBusyError,
    CameraDisconnectedError,
    CameraNotFoundError,
    CameraTimeoutError,
    DriverError,
    ProtocolError,
)
from drivers.ptp import containers
from drivers.ptp.codes import ContainerType
from drivers.ptp.containers import Container
from drivers.ptp.transport import ANSWER_S, DATASET_BYTES, Transport, data_s, put

FORBIDDEN = (
    "This user may not use the camera: let it, by a udev rule for USB cameras (Debian's package "
    "libgphoto2-6 brings one), plug it in again and try again."
)
GONE = "The connection to the camera broke: plug it in again and take the pair anew."

_CLASS = (6, 1, 1)  # still image, capture, PTP
_CANCEL, _RESET = 0x64, 0x66  # requests of the class
_TO_INTERFACE = 0x21  # class request from host to interface
_CANCEL_CODE = 0x4001  # in the data of that request
_BLOCK_BYTES = (1 << 20) + 4096  # read at once; a multiple of every packet size
_ENDLESS = 0xFFFFFFFF  # length of a container of 4 GiB or more
_POLL_MS = 10  # the shortest look for an event; 0 would mean for ever
_HEADER_BYTES = 12
_LONGEST_EVENT = _HEADER_BYTES + 5 * 4  # with all five parameters
_SLICE_MS = 500  # the longest look: while libusb looks, Python handles no Ctrl-C
_EVENT_REST_MS = 100  # for each further packet of an event that has begun
_CLOSING_S = 1.0  # for an answer of a camera that was brought to rest
_AT_REST_S = 0.1  # a camera that was brought to rest and is silent for so long sends no more
_MOST_READS = 600  # enough for the largest photograph


class UsbTransport(Transport):
    """The three endpoints of a still image interface. Raises CameraBusyError on construction."""

    def __init__(self, device: Any, clock: Clock, answer_s: float = ANSWER_S) -> None:
        self._device, self._clock, self._answer_s = device, clock, answer_s
        self._received = bytearray()
        self._event = bytearray()
        self._block = array("B", bytes(_BLOCK_BYTES))
        self._open = True
        self._transaction = self._interface = 0  # until they are known
        with self._translated():
            interface = _still_image(device)
            self._interface = interface.bInterfaceNumber
            with contextlib.suppress(RuntimeError):
                if device.is_kernel_driver_active(self._interface):
                    device.detach_kernel_driver(self._interface)
            usb.util.claim_interface(device, self._interface)
        self._out, self._in, self._events = _endpoints(interface)

    def send(self, container: Container) -> None:
        """Send a command or its data."""
        self._received.clear()  # what is left over belongs to an earlier transaction
        self._transaction = container.transaction
        raw = container.encode()
        with self._translated():
            self._unstalled(self._out, partial(self._write, raw))
            if len(raw) % self._out.wMaxPacketSize == 0:
                self._write(b"")

    def _write(self, raw: bytes) -> None:
        self._device.write(self._out.bEndpointAddress, raw, round(1000 * self._answer_s))

    def receive(self, most: int = DATASET_BYTES, into: memoryview | None = None) -> Container:
        """Take the next data or response container."""
        deadline = self._clock.monotonic() + self._answer_s
        with self._translated():
            if not self._received and not self._read(deadline):
                self._read(deadline)  # one empty packet may come first
            while len(self._received) < _HEADER_BYTES:
                self._read_more(deadline)
            length = struct.unpack_from("<I", self._received)[0]
            deadline += data_s(most, into)
            if length == _ENDLESS:
                length = self._read_to_the_end(most, deadline)
            if not _HEADER_BYTES <= length <= most + _HEADER_BYTES:
                self._reset()
                raise ProtocolError(f"The camera wants to send {length} bytes where {most} may be")
            while len(self._received) < length:
                self._read_more(deadline)
        raw = self._received[:length]
        del self._received[:length]
        container = containers.decode(raw)
        if container.type is ContainerType.DATA:
            return replace(container, payload=put(container.payload, into))
        return container

    def _read_to_the_end(self, most: int, deadline: float) -> int:
        """Read until a short packet; the length then known is put into the container."""
        last = len(self._received)
        while last and last % self._in.wMaxPacketSize == 0 and len(self._received) <= most:
            last = self._read(deadline)
        struct.pack_into("<I", self._received, 0, len(self._received))
        return len(self._received)

    def _read_more(self, deadline: float) -> None:
        if not self._read(deadline) and not self._read(deadline):
            raise ProtocolError("The camera broke a container off")

    def _read(self, deadline: float) -> int:
        left = deadline - self._clock.monotonic()
        if left <= 0:
            raise usb.core.USBTimeoutError("late", errno=errno.ETIMEDOUT)
        # whatever may take long, silence in the middle of it may not
        wait_ms = max(1, round(1000 * min(left, self._answer_s)))
        count: int = self._look(self._in, self._block, wait_ms)
        self._received += memoryview(self._block)[:count]
        return count

    def _look(self, endpoint: Any, into: Any, wait_ms: int) -> Any:
        """Read what comes within wait_ms milliseconds; raises USBTimeoutError where nothing does.

        pyusb gives what had come when a slice ended, so that none of it is lost.
        """
        while True:
            slice_ms = min(wait_ms, _SLICE_MS)
            read = partial(self._device.read, endpoint.bEndpointAddress, into, slice_ms)
            try:
                return self._unstalled(endpoint, read)
            except usb.core.USBTimeoutError:
                wait_ms -= slice_ms
                if wait_ms <= 0:
                    raise

    def _unstalled(self, endpoint: Any, use: Any) -> Any:
        """Use an endpoint; where it has halted, clear that and use it once more."""
        try:
            return use()
        except usb.core.USBError as error:
            if error.errno != errno.EPIPE:
                raise
        self._device.clear_halt(endpoint.bEndpointAddress)
        return use()

    def receive_event(self, timeout_s: float) -> Container | None:
        """Take the next event, waiting at most timeout_s seconds; None if there is none."""
        with self._translated():
            if not self._read_event(max(_POLL_MS, round(1000 * timeout_s))):
                return None
        raw = bytes(self._event)
        self._event.clear()
        event = containers.decode(raw)
        if event.type is not ContainerType.EVENT:
            raise ProtocolError(f"The camera tells of a {event.type.name.lower()} for an event")
        return event

    def _read_event(self, wait_ms: int) -> bool:
        """Read packets until an event is whole; what has come of it stays for the next call.

        wait_ms: how long the first packet may take, in milliseconds.
        """
        while len(self._event) < self._event_length():
            try:
                packet = self._look(self._events, self._events.wMaxPacketSize, wait_ms)
            except usb.core.USBTimeoutError:
                return False
            if not packet:
                return False
            self._event += packet.tobytes()
            wait_ms = _EVENT_REST_MS
        return True

    def _event_length(self) -> int:
        """What the event under way says of itself; nothing is waited for where that cannot be."""
        if len(self._event) < 4:
            return _HEADER_BYTES
        length: int = struct.unpack_from("<I", self._event)[0]
        return length if length <= _LONGEST_EVENT else 0

    def start_afresh(self) -> bool:
        """Bring the camera to rest and read its pipe empty; its session outlasts this program."""
        self._answer_s = min(self._answer_s, _CLOSING_S)
        with self._translated(), contextlib.suppress(usb.core.USBTimeoutError):
            with contextlib.suppress(usb.core.USBError):  # some cameras do not know it
                self._reset()
            for _ in range(_MOST_READS):
                self._received.clear()
                self._read(self._clock.monotonic() + _AT_REST_S)
        return True

    def close(self) -> None:
        """Let go of the interface."""
        if self._open:
            self._open = False
            with contextlib.suppress(usb.core.USBError):
                usb.util.dispose_resources(self._device)

    def _cancel(self) -> None:
        data = struct.pack("<HI", _CANCEL_CODE, self._transaction)
        self._device.ctrl_transfer(_TO_INTERFACE, _CANCEL, 0, self._interface, data, 1000)

    def _reset(self) -> None:
        self._device.ctrl_transfer(_TO_INTERFACE, _RESET, 0, self._interface, b"", 1000)

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        """Turn errors of USB into those of cameras."""
        if not self._open:
            raise CameraDisconnectedError(GONE)
        try:
            yield
        except usb.core.USBTimeoutError as error:
            with contextlib.suppress(usb.core.USBError):
                self._cancel()
            raise CameraTimeoutError(
                f"The camera gave no answer for {self._answer_s:.0f} s: switch it off and on and "
                "take the pair anew."
            ) from error
        except usb.core.USBError as error:
            raise _error_of(error, self._device) from error


def _error_of(error: usb.core.USBError, device: Any) -> DriverError:
    if error.errno == errno.EBUSY:
        return CameraBusyError(
            f"The camera is in use by {_holder(device)}: close that program and try again."
        )
    if error.errno == errno.EACCES:
        return CameraNotFoundError(FORBIDDEN)
    return CameraDisconnectedError(GONE)


def _holder(device: Any) -> str:
    """Name the programs that hold a device open, as far as this user may see them."""
    node = f"/dev/bus/usb/{device.bus:03}/{device.address:03}"
    found = set()
    with contextlib.suppress(OSError):  # of the walk: a program may end in the middle of it
        for link in Path("/proc").glob("[0-9]*/fd/*"):
            with contextlib.suppress(OSError):
                if str(link.readlink()) == node:
                    comm = (link.parents[1] / "comm").read_bytes()  # cut at 15 bytes, of anything
                    found.add("".join(filter(str.isprintable, comm.decode(errors="replace"))))
    return " and ".join(sorted(found)) or "another program"


def _still_image(device: Any) -> Any:
    """Find the interface; a device that is not configured yet is configured first."""
    try:
        configuration = device.get_active_configuration()
    except usb.core.USBError:
        device.set_configuration()
        configuration = device.get_active_configuration()
    found = next(filter(is_still_image, configuration), None)
    if found is None:  # its other configuration has it
        raise ProtocolError("The camera's USB configuration has no interface for photographs")
    return found


def is_still_image(interface: Any) -> bool:
    """Whether an interface is one that cameras speak PTP by."""
    return (
        interface.bInterfaceClass,
        interface.bInterfaceSubClass,
        interface.bInterfaceProtocol,
    ) == _CLASS


def _endpoints(interface: Any) -> tuple[Any, Any, Any]:
    """Bulk out, bulk in and interrupt in."""
    bulk, interrupt = usb.util.ENDPOINT_TYPE_BULK, usb.util.ENDPOINT_TYPE_INTR
    found: dict[tuple[int, bool], Any] = {}
    for endpoint in interface:
        kind = usb.util.endpoint_type(endpoint.bmAttributes)
        inward = usb.util.endpoint_direction(endpoint.bEndpointAddress) == usb.util.ENDPOINT_IN
        found.setdefault((kind, inward), endpoint)
    try:
        return found[bulk, False], found[bulk, True], found[interrupt, True]
    except KeyError as error:
        raise ProtocolError("The camera's USB interface lacks an endpoint") from error
