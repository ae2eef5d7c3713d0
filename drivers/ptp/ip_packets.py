"""Packets of PTP over TCP/IP, on either side of the wire. Source: CIPA DC-005, clause 2.3."""

from __future__ import annotations

import math
import socket
import struct
import time
from dataclasses import dataclass
from enum import IntEnum

from drivers.errors import CameraDisconnectedError, CameraTimeoutError, ProtocolError
from drivers.ptp.containers import Bytes

PORT = 15740
"""Where PTP/IP cameras listen."""

VERSION = 0x00010000

GUID_BYTES = 16

SMALL_BYTES = 1024
"""No packet but those of data is longer."""

_HEADER = struct.Struct("<II")
_PATIENCE_S = 10.0  # for the rest of a packet that has begun


class PacketType(IntEnum):
    """What a packet is for."""

    INIT_COMMAND_REQUEST = 1
    INIT_COMMAND_ACK = 2
    INIT_EVENT_REQUEST = 3
    INIT_EVENT_ACK = 4
    INIT_FAIL = 5
    OPERATION = 6
    RESPONSE = 7
    EVENT = 8
    START_DATA = 9
    DATA = 10
    CANCEL = 11
    END_DATA = 12
    PROBE_REQUEST = 13
    PROBE_RESPONSE = 14


class InitFail(IntEnum):
    """Why a responder takes no initiator."""

    REJECTED = 1
    BUSY = 2
    OTHER = 3


@dataclass(frozen=True)
class Greeting:
    """Who one is: in the request (no number) and in the answer to it. guid: 16 bytes."""

    guid: bytes
    name: str

    def encode(self) -> bytes:
        """As bytes on the wire."""
        return self.guid + (self.name + "\0").encode("utf-16-le") + struct.pack("<I", VERSION)

    @classmethod
    def decode(cls, payload: bytes) -> Greeting:
        """Read it. Raises ProtocolError for bytes that are no greeting."""
        if len(payload) < GUID_BYTES + 2 + 4 or len(payload) % 2:
            raise ProtocolError(f"A PTP/IP greeting cannot have {len(payload)} bytes")
        name = payload[GUID_BYTES:-4].decode("utf-16-le", "replace")
        return cls(payload[:GUID_BYTES], name.partition("\0")[0])


def encode_packet(kind: PacketType, *parts: Bytes) -> bytes:
    """As bytes on the wire."""
    payload = b"".join(parts)
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


class PacketStream:
    """Packets over one TCP connection.

    silence_s: how long the other side may send nothing while something is read, in seconds,
    whatever deadline there is for all of it.
    """

    def __init__(self, connection: socket.socket, silence_s: float = math.inf) -> None:
        self.socket = connection
        self._silence_s = silence_s
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, kind: PacketType, *parts: Bytes) -> None:
        """Send a packet. Raises CameraDisconnectedError, CameraTimeoutError."""
        *first, last = parts or (b"",)
        if len(last) < SMALL_BYTES:
            self.send_raw(encode_packet(kind, *parts))
            return
        length = _HEADER.size + sum(map(len, parts))
        self.send_raw(_HEADER.pack(length, kind) + b"".join(first))
        self.send_raw(last)

    def send_raw(self, raw: Bytes) -> None:
        """Send bytes. Raises like send()."""
        try:
            self.socket.settimeout(_PATIENCE_S)
            self.socket.sendall(raw)
        except TimeoutError as error:
            raise CameraTimeoutError(_NOT_TAKEN) from error
        except OSError as error:
            raise CameraDisconnectedError(BROKEN) from error

    def header(self, deadline: float) -> tuple[PacketType, int]:
        """Read what comes next and how many bytes of payload it has.

        deadline: of time.monotonic(), for its first byte. Raises CameraTimeoutError,
        CameraDisconnectedError, ProtocolError.
        """
        head = self.read(_HEADER.size, deadline)
        length, kind = _HEADER.unpack(head)
        if length < _HEADER.size:
            raise ProtocolError(f"A PTP/IP packet cannot have {length} bytes")
        try:
            return PacketType(kind), length - _HEADER.size
        except ValueError as error:
            raise ProtocolError(f"A PTP/IP packet is of the unknown type {kind}") from error

    def packet(self, deadline: float) -> tuple[PacketType, bytes]:
        """Read a packet that carries no data. Raises like header()."""
        kind, length = self.header(deadline)
        if length > SMALL_BYTES:
            raise ProtocolError(f"A PTP/IP packet of type {kind} cannot have {length} bytes")
        return kind, self.read(length, time.monotonic() + _PATIENCE_S)

    def read(self, count: int, deadline: float) -> bytes:
        """Read exactly count bytes."""
        data = bytearray(count)
        self.read_into(memoryview(data), deadline)
        return bytes(data)

    def read_into(self, view: memoryview, deadline: float) -> None:
        """Fill a view."""
        while view:
            left = deadline - time.monotonic()
            if left <= 0:
                raise CameraTimeoutError(SILENT)
            try:
                self.socket.settimeout(min(left, self._silence_s))
                received = self.socket.recv_into(view)
            except TimeoutError as error:
                raise CameraTimeoutError(SILENT) from error
            except OSError as error:
                raise CameraDisconnectedError(BROKEN) from error
            if not received:
                raise CameraDisconnectedError(BROKEN)
            view = view[received:]

    def close(self) -> None:
        """Hang up. Closing twice is fine."""
        self.socket.close()


BROKEN = "The connection to the camera broke: connect it again and take the pair anew."
SILENT = (
    "The camera stopped answering: switch it off and on, check its network and take the pair anew."
)
_NOT_TAKEN = "The camera takes nothing in any more: switch it off and on and take the pair anew."
