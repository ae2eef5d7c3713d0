"""PTP over TCP/IP: a camera on the network. Source: CIPA DC-005."""

from __future__ import annotations

import select
import socket
import struct
import time
import uuid
from collections import deque
from urllib.parse import urlsplit

from drivers.camera import Camera, CameraInfo
from drivers.clock import SystemClock
from drivers.errors import (
    BadAddressError,
    CameraBusyError,
    CameraDisconnectedError,
    CameraNotFoundError,
    CameraTimeoutError,
    ProtocolError,
)
from drivers.ptp.camera import open_awake
from drivers.ptp.codes import SENDS_DATA, ContainerType
from drivers.ptp.containers import Container
from drivers.ptp.ip_packets import (
    BROKEN,
    PORT,
    Greeting,
    InitFail,
    PacketStream,
    PacketType,
)
from drivers.ptp.transport import ANSWER_S, DATASET_BYTES, Transport, data_s, put

ANNOUNCED: dict[str, CameraInfo] = {}
"""Cameras on the network by what they call themselves; drivers.ptp.mdns fills it, once asked to."""

_CONNECT_S = 5.0
_MOST_WAITING = 1000  # events; of more that come while an answer is waited for, the oldest go
_LEAVING_PAUSES_S = (0.1, 0.3, 0.6)  # before tries, while a camera lets go of who left
_NO_DATA, _DATA_OUT = 1, 2  # data phases of an operation request
_UNTOLD = (0xFFFFFFFFFFFFFFFF, 0xFFFFFFFF)  # sizes of data that end where they end

_FAILURES = {
    InitFail.REJECTED: "The camera at {} turned this computer away: let it connect in the "
    "camera's menu and try again.",
    InitFail.BUSY: "The camera at {} is in use by another program: close that one and try again.",
    InitFail.OTHER: "The camera at {} takes no connection now: switch it off and on and try again.",
}


class IpTransport(Transport):
    """Two TCP connections, one for operations and their data, one for events.

    answer_s: how long the camera may take for an answer, in seconds. Raises CameraNotFoundError,
    CameraBusyError, CameraTimeoutError, ProtocolError on construction.
    """

    def __init__(self, host: str, port: int = PORT, answer_s: float = ANSWER_S) -> None:
        self._place = f"{host}:{port}"
        self._answer_s = answer_s
        self._waiting: deque[Container] = deque(maxlen=_MOST_WAITING)
        self._operation = self._transaction = 0
        self._streams: list[PacketStream] = []
        try:
            self._commands = self._connect(host, port)
            name = Greeting(_own_guid(), "lightlayers")
            self._commands.send(PacketType.INIT_COMMAND_REQUEST, name.encode())
            answer = self._greeted(self._commands, PacketType.INIT_COMMAND_ACK)
            if len(answer) < 4:
                raise ProtocolError("The camera's PTP/IP greeting has no connection number")
            Greeting.decode(answer[4:])  # what answers is a camera, or this raises
            self._events = self._connect(host, port)
            self._events.send(PacketType.INIT_EVENT_REQUEST, answer[:4])
            self._greeted(self._events, PacketType.INIT_EVENT_ACK)
        except BaseException:
            self.close()
            raise

    def _connect(self, host: str, port: int) -> PacketStream:
        try:
            connection = socket.create_connection((host, port), timeout=_CONNECT_S)
        except (OSError, UnicodeError) as error:
            raise CameraNotFoundError(
                f"No camera answers at {self._place}: switch it on, connect it to this network "
                "and try again."
            ) from error
        self._streams.append(PacketStream(connection, self._answer_s))
        return self._streams[-1]

    def _greeted(self, stream: PacketStream, expected: PacketType) -> bytes:
        kind, payload = stream.packet(time.monotonic() + self._answer_s)
        if kind is PacketType.INIT_FAIL:
            reason = int.from_bytes(payload[:4], "little")
            known = InitFail(reason) if reason in list(InitFail) else InitFail.OTHER
            raise CameraBusyError(_FAILURES[known].format(self._place))
        if kind is not expected:
            raise ProtocolError(f"The camera greets with the PTP/IP packet {kind.name}")
        return payload

    def send(self, container: Container) -> None:
        """Send a command or its data."""
        transaction = struct.pack("<I", container.transaction)
        if container.type is ContainerType.COMMAND:
            self._operation, self._transaction = container.code, container.transaction
            phase = _DATA_OUT if container.code in SENDS_DATA else _NO_DATA
            head = struct.pack("<IHI", phase, container.code, container.transaction)
            self._commands.send(PacketType.OPERATION, head, container.payload)
            return
        size = struct.pack("<Q", len(container.payload))
        self._commands.send(PacketType.START_DATA, transaction, size)
        self._commands.send(PacketType.END_DATA, transaction, container.payload)

    def receive(self, most: int = DATASET_BYTES, into: memoryview | None = None) -> Container:
        """Take the next data or response container."""
        deadline = time.monotonic() + self._answer_s
        self._await_commands(deadline)
        kind, length = self._commands.header(deadline)
        if kind is PacketType.START_DATA and length == 12:
            return self._receive_data(most, into, deadline + data_s(most, into))
        if kind is not PacketType.RESPONSE or not 6 <= length <= 26 or (length - 6) % 4:
            raise ProtocolError(f"The camera answers with a PTP/IP packet {kind.name} of {length}")
        payload = self._commands.read(length, deadline)
        code, transaction = struct.unpack_from("<HI", payload)
        return Container(ContainerType.RESPONSE, code, transaction, payload[6:])

    def _receive_data(self, most: int, into: memoryview | None, deadline: float) -> Container:
        transaction, size = struct.unpack("<IQ", self._commands.read(12, deadline))
        if size in _UNTOLD:
            untold = self._receive_untold(transaction, most, deadline)
            return Container(ContainerType.DATA, self._operation, transaction, put(untold, into))
        if size > most:
            self._cancel()
            raise ProtocolError(f"The camera wants to send {size} bytes where {most} are the most")
        if into is None or size > len(into):
            into = memoryview(bytearray(size))
        data = into[:size]
        filled, last = 0, False
        while not last:
            last, count = self._next_data(transaction, size - filled, deadline)
            self._commands.read_into(data[filled : filled + count], deadline)
            filled += count
        if filled != size:
            raise ProtocolError(f"The camera sent {filled} of {size} bytes of data")
        return Container(ContainerType.DATA, self._operation, transaction, data)

    def _receive_untold(self, transaction: int, most: int, deadline: float) -> bytearray:
        """Take data of which the camera does not know beforehand how many they are."""
        data, last = bytearray(), False
        while not last:
            last, count = self._next_data(transaction, most - len(data), deadline)
            data += self._commands.read(count, deadline)
        return data

    def _next_data(self, transaction: int, most: int, deadline: float) -> tuple[bool, int]:
        """Take the head of a packet of data; whether it is the last, and its bytes."""
        kind, length = self._commands.header(deadline)
        if kind not in (PacketType.DATA, PacketType.END_DATA) or not 4 <= length <= most + 4:
            raise ProtocolError(f"The camera's data have a PTP/IP packet {kind.name} of {length}")
        if self._commands.read(4, deadline) != struct.pack("<I", transaction):
            raise ProtocolError("The camera's data are of two transactions")
        return kind is PacketType.END_DATA, length - 4

    def _cancel(self) -> None:
        """Tell the camera to forget the operation under way; what still comes is not read."""
        transaction = struct.pack("<I", self._transaction)
        self._events.send(PacketType.CANCEL, transaction)

    def _await_commands(self, deadline: float) -> None:
        """Wait for an answer; take in what is told meanwhile, so that probes get theirs."""
        while True:
            ready = self._ready([self._commands, self._events], deadline - time.monotonic())
            if self._commands in ready:
                return
            if not ready or time.monotonic() > deadline:  # events alone are no answer
                self._give_up()
            self._take_event()

    def _give_up(self) -> None:
        """Tell a camera that is hung from one that is gone, by a probe."""
        self._cancel()
        self._events.send(PacketType.PROBE_REQUEST)
        alive = self._ready([self._events], min(1.0, self._answer_s))
        raise CameraTimeoutError(
            f"The camera gave no answer for {self._answer_s:.0f} s"
            + (", though it is there" if alive else "")
            + ": switch it off and on and take the pair anew."
        )

    def receive_event(self, timeout_s: float) -> Container | None:
        """Take the next event, waiting at most timeout_s seconds; None if there is none."""
        deadline = time.monotonic() + timeout_s
        while not self._waiting:
            if not self._ready([self._events], max(0.0, deadline - time.monotonic())):
                return None
            self._take_event()
            if not self._waiting and time.monotonic() > deadline:  # probes alone are no event
                return None
        return self._waiting.popleft()

    def _take_event(self) -> None:
        kind, payload = self._events.packet(time.monotonic() + self._answer_s)
        if kind is PacketType.PROBE_REQUEST:
            self._events.send(PacketType.PROBE_RESPONSE)
        elif kind is PacketType.EVENT:
            if not 6 <= len(payload) <= 26 or (len(payload) - 6) % 4:
                raise ProtocolError(f"A PTP/IP event cannot have {len(payload)} bytes")
            code, transaction = struct.unpack_from("<HI", payload)
            self._waiting.append(Container(ContainerType.EVENT, code, transaction, payload[6:]))
        elif kind not in (PacketType.PROBE_RESPONSE, PacketType.CANCEL):
            raise ProtocolError(f"The camera tells events by the PTP/IP packet {kind.name}")

    def _ready(self, streams: list[PacketStream], timeout_s: float) -> list[PacketStream]:
        if any(stream.socket.fileno() < 0 for stream in streams):
            raise CameraDisconnectedError(BROKEN)
        found, _, _ = select.select([s.socket for s in streams], [], [], max(0.0, timeout_s))
        return [stream for stream in streams if stream.socket in found]

    def close(self) -> None:
        """Hang up."""
        for stream in self._streams:
            stream.close()


def _own_guid() -> bytes:
    """Name this computer; cameras remember by it whom they let in."""
    return uuid.uuid5(uuid.NAMESPACE_URL, f"lightlayers:{uuid.getnode():x}").bytes


def open_camera(address: str) -> Camera:
    """Open the camera at ptp+ip://host[:port]."""
    host, port = parse(address)
    return open_awake(address, lambda: _connect_patiently(host, port), SystemClock())


def _connect_patiently(host: str, port: int) -> IpTransport:
    """Connect; a camera may take a moment to notice that its last visitor has left."""
    for pause in _LEAVING_PAUSES_S:
        try:
            return IpTransport(host, port)
        except CameraBusyError:
            time.sleep(pause)
    return IpTransport(host, port)


def check_address(address: str) -> None:
    """Read the address without connecting to it. Raises BadAddressError."""
    parse(address)


def list_cameras() -> list[CameraInfo]:
    """List those that announced themselves, if listening to the network was begun."""
    return sorted(ANNOUNCED.values(), key=lambda camera: camera.address)


def parse(address: str) -> tuple[str, int]:
    """Split ptp+ip://host[:port]. Raises BadAddressError."""
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port, parts = None, None, urlsplit("")
    more = parts.path.strip("/") or parts.query or "@" in parts.netloc
    if not host or not host.isprintable() or port == 0 or more:
        raise BadAddressError(
            f"{address!r} is no address of a camera on the network: write ptp+ip://host or "
            f"ptp+ip://host:port, where port is {PORT} if it is left out."
        )
    return host, port or PORT
