"""The simulated camera on the network: its responder behind PTP/IP. Source: CIPA DC-005."""

from __future__ import annotations

import contextlib
import logging
import secrets
import socket
import struct
import threading
import time
from typing import Any, cast, get_args

from drivers.errors import BadAddressError, DriverError, ProtocolError
from drivers.ptp import containers
from drivers.ptp.codes import SENDS_DATA, ContainerType
from drivers.ptp.containers import Container
from drivers.ptp.ip_packets import (
    GUID_BYTES,
    Greeting,
    InitFail,
    PacketStream,
    PacketType,
    encode_packet,
)
from drivers.sim.body import Body, FlashSwitch
from drivers.sim.faults import Fault
from drivers.sim.responder import Responder

_GREETING_S = 5.0  # for an initiator to introduce itself, or to send the data it announced
_IDLE_S = 3600.0  # without a request, after which an initiator is gone
_LONGEST_VALUE = 1 << 16  # of a property that an initiator sets
_SLOW_BYTES_PER_S = 4_000_000
_BLOCK_BYTES = 1 << 16
_SHORT_BYTES = 1001

log = logging.getLogger("drivers.sim.ip_responder")


class IpResponder:
    """Serves one initiator at a time; others are told that the camera is busy.

    port: 0 takes any free one. Raises BadAddressError where the place is taken.
    """

    def __init__(self, body: Body, host: str = "127.0.0.1", port: int = 0) -> None:
        self.body, self.model = body, body.model.model
        self._guid = secrets.token_bytes(GUID_BYTES)
        try:
            host.encode("idna")  # as sockets do, whose own error would be a TypeError
            self._listener = socket.create_server((host, port))
        except (OSError, OverflowError, UnicodeError) as error:
            raise BadAddressError(
                f"The simulated camera cannot listen on {host}:{port}: choose another --port or "
                "--host."
            ) from error
        body.prepare()  # which takes long, so that a place that is taken is told first
        self.address: str = "{}:{}".format(*self._listener.getsockname()[:2])
        self._lock = threading.Lock()  # of the two below
        self._client: _Client | None = None
        self._numbers = 0
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return  # closed
            threading.Thread(target=self._greet, args=(connection,), daemon=True).start()

    def _greet(self, connection: socket.socket) -> None:
        stream = PacketStream(connection)
        try:
            kind, payload = stream.packet(time.monotonic() + _GREETING_S)
            if kind is PacketType.INIT_COMMAND_REQUEST:
                Greeting.decode(payload)  # raises where it is none; who asks does not matter
                self._welcome(stream)
            elif kind is PacketType.INIT_EVENT_REQUEST and len(payload) == 4:
                self._join(stream, int.from_bytes(payload, "little"))
            else:
                stream.send(PacketType.INIT_FAIL, struct.pack("<I", InitFail.REJECTED))
        except DriverError as error:
            log.info("an initiator left: %s", error)
        finally:
            stream.close()

    def _welcome(self, stream: PacketStream) -> None:
        with self._lock:
            taken = self._client is not None
            if not taken:
                self._numbers += 1
                client = self._client = _Client(self.body, stream, self._numbers)
        if taken:
            stream.send(PacketType.INIT_FAIL, struct.pack("<I", InitFail.BUSY))
            return
        try:
            number, name = struct.pack("<I", client.number), self.model
            stream.send(PacketType.INIT_COMMAND_ACK, number, Greeting(self._guid, name).encode())
            client.answer_commands()
        finally:
            client.leave()
            with self._lock:
                self._client = None

    def _join(self, stream: PacketStream, number: int) -> None:
        with self._lock:
            client = self._client
        if client is None or client.number != number:
            stream.send(PacketType.INIT_FAIL, struct.pack("<I", InitFail.REJECTED))
            return
        stream.send(PacketType.INIT_EVENT_ACK)
        client.tell_events(stream)

    def order(self, line: str) -> None:
        """Do as "fault NAME" or "flash mode|off|external" says. Raises BadAddressError."""
        match line.split():
            case ["fault", fault] if fault in get_args(Fault):
                self.body.fault = cast(Fault, fault)
            case ["flash", switch] if switch in get_args(FlashSwitch):
                self.body.flash = cast(FlashSwitch, switch)
            case _:
                known = ", ".join(get_args(Fault))
                raise BadAddressError(
                    'The simulated camera takes the lines "flash mode", "flash off", "flash '
                    f'external", and "fault NAME" with one of {known}.'
                )

    def close(self) -> None:
        """Stop listening and hang up."""
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            client = self._client
        if client:
            client.leave()


Packet = tuple[Any, ...]
"""The kind of a packet and the parts of its payload."""


def _packets(container: Container) -> list[Packet]:
    transaction = struct.pack("<I", container.transaction)
    if container.type is not ContainerType.DATA:
        code = struct.pack("<H", container.code)
        return [(PacketType.RESPONSE, code, transaction, container.payload)]
    size = struct.pack("<Q", len(container.payload))
    return [
        (PacketType.START_DATA, transaction, size),
        (PacketType.END_DATA, transaction, container.payload),
    ]


class _Client:
    """The initiator that is connected. The camera itself is used under its lock."""

    def __init__(self, body: Body, stream: PacketStream, number: int) -> None:
        self.number = number
        self._body = body
        self._stream = stream
        self._events: PacketStream | None = None
        self._responder = Responder(body)
        self._changed = threading.Condition()
        self._gone = False

    def leave(self) -> None:
        """Hang up, and end the thread that tells events."""
        with self._changed:
            self._gone = True
            self._changed.notify_all()
        for stream in (self._stream, self._events):
            if stream:
                with contextlib.suppress(OSError):
                    stream.socket.shutdown(socket.SHUT_RDWR)

    def answer_commands(self) -> None:
        """Answer operations until the initiator leaves. Raises DriverError then."""
        while not self._gone:
            command, data = self._take()
            with self._changed:
                answers = self._responder.answer(command)
                if data is not None:
                    answers += self._responder.answer(data)
                self._changed.notify_all()
            if self._responder.unplugged:
                return
            self._send(answers)

    def _take(self) -> tuple[Container, Container | None]:
        kind, payload = self._stream.packet(time.monotonic() + _IDLE_S)
        while kind is not PacketType.OPERATION:
            if kind is PacketType.PROBE_REQUEST:
                self._stream.send(PacketType.PROBE_RESPONSE)
            elif kind is not PacketType.CANCEL:
                raise ProtocolError(f"The initiator sent {kind.name} for an operation")
            kind, payload = self._stream.packet(time.monotonic() + _IDLE_S)
        if not 10 <= len(payload) <= 30 or (len(payload) - 10) % 4:
            raise ProtocolError(f"An operation cannot have {len(payload)} bytes")
        _, code, transaction = struct.unpack_from("<IHI", payload)
        command = Container(ContainerType.COMMAND, code, transaction, payload[10:])
        if code not in SENDS_DATA:
            return command, None
        data = Container(ContainerType.DATA, code, transaction, self._take_data(transaction))
        return command, data

    def _take_data(self, transaction: int) -> bytes:
        deadline = time.monotonic() + _GREETING_S
        kind, payload = self._stream.packet(deadline)
        if kind is not PacketType.START_DATA or len(payload) != 12:
            raise ProtocolError(f"The initiator sent {kind.name} for data")
        size = struct.unpack_from("<Q", payload, 4)[0]
        if size > _LONGEST_VALUE:
            raise ProtocolError(f"The initiator wants to send {size} bytes")
        data = b""
        while kind is not PacketType.END_DATA:
            kind, payload = self._stream.packet(deadline)
            if kind not in (PacketType.DATA, PacketType.END_DATA) or payload[:4] != struct.pack(
                "<I", transaction
            ):
                raise ProtocolError(f"The initiator sent {kind.name} among its data")
            data += payload[4:]
            if len(data) > size:
                raise ProtocolError("The initiator sent more data than it said")
        return data

    def _send(self, answers: list[Container]) -> None:
        packets = [packet for answer in answers for packet in _packets(answer)]
        if self._body.fault == "slow_link":
            self._send_in_pieces(packets, _BLOCK_BYTES, _BLOCK_BYTES / _SLOW_BYTES_PER_S)
        elif self._body.fault == "short_packets":
            self._send_in_pieces(packets, _SHORT_BYTES, 0)
        elif self._body.fault == "glued_packets":
            self._send_in_pieces(packets, _LONGEST_VALUE << 10, 0)
        else:
            for packet in packets:
                self._stream.send(*packet)

    def _send_in_pieces(self, packets: list[Packet], size: int, pause_s: float) -> None:
        raw = b"".join(encode_packet(*packet) for packet in packets)
        for at in range(0, len(raw), size):
            self._stream.send_raw(raw[at : at + size])
            time.sleep(pause_s if at + size < len(raw) else 0)

    def tell_events(self, stream: PacketStream) -> None:
        """Tell what happens, and answer probes, until the initiator leaves."""
        self._events = stream
        threading.Thread(target=self._answer_probes, args=(stream,), daemon=True).start()
        while not self._gone:
            with self._changed:
                raw = self._responder.next_event()
                if raw is None:
                    self._changed.wait(self._body.seconds_to_wait())
                    continue
            event = containers.decode(raw)
            head = struct.pack("<HI", event.code, event.transaction)
            stream.send(PacketType.EVENT, head, event.payload)

    def _answer_probes(self, stream: PacketStream) -> None:
        try:
            while not self._gone:
                kind, _ = stream.packet(time.monotonic() + _IDLE_S)
                if kind is PacketType.PROBE_REQUEST:
                    stream.send(PacketType.PROBE_RESPONSE)
        except DriverError as error:
            log.info("an initiator listens no more: %s", error)
