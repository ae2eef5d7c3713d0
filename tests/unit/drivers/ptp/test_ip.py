from __future__ import annotations

import contextlib
import math
import socket
import struct
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from drivers.clock import Clock
from drivers.errors import (
    BadAddressError,
    CameraBusyError,
    CameraDisconnectedError,
    CameraTimeoutError,
    DriverError,
    ProtocolError,
)
from drivers.ptp.codes import ContainerType, Operation
from drivers.ptp.containers import Container
from drivers.ptp.ip import IpTransport, check_address, parse
from drivers.ptp.ip_packets import Greeting, PacketStream, PacketType, encode_packet
from drivers.ptp.session import Session

ACK = encode_packet(
    PacketType.INIT_COMMAND_ACK, b"\x07\0\0\0", Greeting(b"g" * 16, "Camera").encode()
)
EVENT_ACK = encode_packet(PacketType.INIT_EVENT_ACK)
COMMAND = Container.with_parameters(ContainerType.COMMAND, Operation.GET_DEVICE_INFO, 5, (1, 2))
RESPONSE = encode_packet(PacketType.RESPONSE, struct.pack("<HI", 0x2001, 5))
START = encode_packet(PacketType.START_DATA, struct.pack("<IQ", 5, 10))

UNTOLD = encode_packet(PacketType.START_DATA, struct.pack("<IQ", 5, 2**64 - 1))


class Peer:
    """A camera of a script: what it says on either connection, and what it was told."""

    def __init__(self, commands: bytes, events: bytes = EVENT_ACK, hang_up: bool = False) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.connections: list[socket.socket] = []
        self._said, self._hang_up = (commands, events), hang_up
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        self._listener.settimeout(60)
        for said in self._said:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            connection.sendall(said)
            if self._hang_up:
                connection.shutdown(socket.SHUT_WR)
            self.connections.append(connection)

    def told(self, which: int) -> bytes:
        self._thread.join()
        self.connections[which].settimeout(60)
        return self.connections[which].recv(4096)

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        for each in (self._listener, *self.connections):
            each.close()


def meeting(
    commands: bytes, events: bytes = b"", hang_up: bool = False, answer_s: float = 10
) -> tuple[IpTransport, Peer]:
    """answer_s: how long an answer may take; short for those that do not come."""
    peer = Peer(ACK + commands, EVENT_ACK + events, hang_up)
    return IpTransport("127.0.0.1", peer.port, answer_s=answer_s), peer


def test_both_connections_are_greeted() -> None:
    transport, peer = meeting(b"")
    first, second = peer.told(0), peer.told(1)
    transport.close()
    peer.close()
    assert first[:8] == struct.pack("<II", len(first), 1)
    assert Greeting.decode(first[8:]).name == "lightlayers"
    assert second == struct.pack("<III", 12, 3, 7)


def test_nothing_is_asked_of_a_closed_camera() -> None:
    transport, peer = meeting(b"")
    transport.close()
    transport.close()
    with pytest.raises(CameraDisconnectedError, match="connection to the camera broke"):
        transport.receive()
    with pytest.raises(CameraDisconnectedError, match="connection to the camera broke"):
        transport.receive_event(0)
    peer.close()


def test_operations_and_their_data_are_written_as_packets() -> None:
    transport, peer = meeting(b"")
    greeting = len(peer.told(0))
    transport.send(COMMAND)
    assert greeting and peer.told(0) == struct.pack("<IIIHIII", 26, 6, 1, 0x1001, 5, 1, 2)
    setting = Container.with_parameters(ContainerType.COMMAND, 0x1016, 6, (0x500C,))
    transport.send(setting)
    transport.send(Container(ContainerType.DATA, 0x1016, 6, b"\2\0"))
    told = b""
    expected = (
        struct.pack("<IIIHII", 22, 6, 2, 0x1016, 6, 0x500C)
        + struct.pack("<IIIQ", 20, 9, 6, 2)
        + struct.pack("<III", 14, 12, 6)
        + b"\2\0"
    )
    while len(told) < len(expected):
        told += peer.told(0)
    transport.close()
    peer.close()
    assert told == expected


@contextlib.contextmanager
def telling_without_end(peer: Peer, packet: bytes) -> Iterator[None]:
    """Have a camera tell one thing on and on; ends once the transport is closed."""
    peer.told(1)

    def tell() -> None:
        with contextlib.suppress(OSError):
            while True:
                peer.connections[1].sendall(100 * packet)

    telling = threading.Thread(target=tell)
    telling.start()
    yield
    telling.join()
    peer.close()


def test_events_without_end_are_no_answer() -> None:
    transport, peer = meeting(b"", answer_s=0.4)
    event = encode_packet(PacketType.EVENT, struct.pack("<HI", 0x4002, 0))
    with telling_without_end(peer, event), contextlib.closing(transport):
        transport.send(COMMAND)
        with pytest.raises(CameraTimeoutError, match="though it is there"):
            transport.receive()


def test_of_too_many_events_the_latest_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.ptp.ip._MOST_WAITING", 3)
    events = (encode_packet(PacketType.EVENT, struct.pack("<HII", 0x4002, 0, n)) for n in range(5))
    transport, peer = meeting(b"", b"".join(events), answer_s=0.4)
    transport.send(COMMAND)
    with pytest.raises(CameraTimeoutError):
        transport.receive()
    told = []
    while event := transport.receive_event(0):
        told.append(event.parameters[0])
    transport.close()
    peer.close()
    assert told == [2, 3, 4]


@pytest.mark.parametrize("kind", [PacketType.PROBE_RESPONSE, PacketType.CANCEL])
def test_what_is_no_event_is_not_taken_in_without_end(kind: PacketType) -> None:
    transport, peer = meeting(b"")
    with telling_without_end(peer, encode_packet(kind)), contextlib.closing(transport):
        assert transport.receive_event(0.1) is None


def test_data_in_several_packets_are_put_together() -> None:
    parts = encode_packet(PacketType.DATA, b"\5\0\0\0", b"photo") + encode_packet(
        PacketType.END_DATA, b"\5\0\0\0", b"graph"
    )
    transport, peer = meeting(START + parts + RESPONSE)
    transport.send(COMMAND)
    data, response = transport.receive(), transport.receive()
    transport.close()
    peer.close()
    assert (data.type, data.code, data.transaction) == (ContainerType.DATA, 0x1001, 5)
    assert bytes(data.payload) == b"photograph"
    assert (response.type, response.code) == (ContainerType.RESPONSE, 0x2001)


@pytest.mark.parametrize("size", [0xFFFFFFFF, 0xFFFFFFFFFFFFFFFF])
@pytest.mark.parametrize("room", [None, 10, 12, 4])
def test_data_of_untold_length_end_where_they_end(size: int, room: int | None) -> None:
    parts = [
        encode_packet(PacketType.START_DATA, struct.pack("<IQ", 5, size)),
        encode_packet(PacketType.DATA, b"\5\0\0\0", b"photo"),
        encode_packet(PacketType.DATA, b"\5\0\0\0"),
        encode_packet(PacketType.END_DATA, b"\5\0\0\0", b"graph"),
    ]
    transport, peer = meeting(b"".join(parts) + RESPONSE)
    into = None if room is None else memoryview(bytearray(room))
    transport.send(COMMAND)
    data, response = transport.receive(most=10, into=into), transport.receive()
    transport.close()
    peer.close()
    assert bytes(data.payload) == b"photograph"
    assert response.code == 0x2001
    if room and room >= 10:
        assert into is not None and bytes(into[:10]) == b"photograph"


def test_data_of_untold_length_are_no_more_than_may_come() -> None:
    parts = [
        UNTOLD,
        encode_packet(PacketType.DATA, b"\5\0\0\0", b"photo"),
        encode_packet(PacketType.END_DATA, b"\5\0\0\0", b"graphs"),
    ]
    transport, peer = meeting(b"".join(parts))
    transport.send(COMMAND)
    with pytest.raises(ProtocolError, match="PTP/IP packet END_DATA of 10"):
        transport.receive(most=10)
    transport.close()
    peer.close()


def test_more_data_than_may_come_are_cancelled() -> None:
    transport, peer = meeting(encode_packet(PacketType.START_DATA, struct.pack("<IQ", 5, 11)))
    peer.told(1)  # the greeting
    transport.send(COMMAND)
    with pytest.raises(ProtocolError, match="wants to send 11 bytes where 10 are the most"):
        transport.receive(most=10)
    told = peer.told(1)
    transport.close()
    peer.close()
    assert told == encode_packet(PacketType.CANCEL, struct.pack("<I", 5))


def test_packets_that_come_byte_by_byte_are_put_together() -> None:
    end = encode_packet(PacketType.END_DATA, b"\5\0\0\0", b"photograph")
    transport, peer = meeting(b"")
    peer.told(1)

    def drip() -> None:
        peer.connections[0].setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for byte in START + end + RESPONSE:
            peer.connections[0].sendall(bytes([byte]))
            time.sleep(0.001)

    dripping = threading.Thread(target=drip)
    dripping.start()
    transport.send(COMMAND)
    data, response = transport.receive(), transport.receive()
    dripping.join()
    transport.close()
    peer.close()
    assert bytes(data.payload) == b"photograph"
    assert response.code == 0x2001


def test_silence_in_the_middle_of_data_is_not_waited_out() -> None:
    """As of a camera that is switched off, which nothing on the network tells."""
    most = 1 << 24
    start = encode_packet(PacketType.START_DATA, struct.pack("<IQ", 5, most))
    begun_data = struct.pack("<III", most + 12, PacketType.END_DATA, 5) + b"photo"
    transport, peer = meeting(start + begun_data, answer_s=0.4)
    transport.send(COMMAND)
    begun = time.monotonic()
    with pytest.raises(CameraTimeoutError, match="stopped answering"):
        transport.receive(most)
    assert time.monotonic() - begun < 5
    transport.close()
    peer.close()


@pytest.mark.parametrize(
    ("said", "error"),
    [
        (b"\0\0\0\0\7\0\0\0", ProtocolError),  # shorter than its header
        (b"\x08\0\0\0\x63\0\0\0", ProtocolError),  # an unknown type
        (encode_packet(PacketType.RESPONSE, bytes(7)), ProtocolError),
        (encode_packet(PacketType.RESPONSE, bytes(30)), ProtocolError),
        (encode_packet(PacketType.EVENT, bytes(6)), ProtocolError),
        (encode_packet(PacketType.START_DATA, struct.pack("<IQ", 5, 2**63)), ProtocolError),
        (START + RESPONSE, ProtocolError),
        (UNTOLD + struct.pack("<III", 2**32 - 1, PacketType.DATA, 5), ProtocolError),
        (UNTOLD + struct.pack("<III", (1 << 20) + 13, PacketType.DATA, 5), ProtocolError),
        (START + encode_packet(PacketType.END_DATA, b"\5\0\0\0", b"too short"), ProtocolError),
        (START + encode_packet(PacketType.END_DATA, b"\5\0\0\0", b"far too long"), ProtocolError),
        (START + encode_packet(PacketType.END_DATA, b"\6\0\0\0", b"photograph"), ProtocolError),
        (START + encode_packet(PacketType.END_DATA, b"\5"), ProtocolError),
        (START[:10], CameraDisconnectedError),
        (b"", CameraDisconnectedError),
    ],
)
def test_what_cannot_be_is_refused(said: bytes, error: type[DriverError]) -> None:
    transport, peer = meeting(said, hang_up=True)
    transport.send(COMMAND)
    with pytest.raises(error):
        transport.receive()
    transport.close()
    peer.close()


def test_events_come_on_their_own_connection_and_probes_are_answered() -> None:
    event = encode_packet(PacketType.EVENT, struct.pack("<HII", 0x4002, 0, 9))
    transport, peer = meeting(b"", encode_packet(PacketType.PROBE_REQUEST) + event)
    told = transport.receive_event(5)
    assert told is not None
    assert (told.code, told.parameters) == (0x4002, (9,))
    assert transport.receive_event(0) is None
    answered = peer.told(1)
    transport.close()
    peer.close()
    assert answered.endswith(encode_packet(PacketType.PROBE_RESPONSE))


def test_silence_is_cancelled_and_probed() -> None:
    transport, peer = meeting(b"", answer_s=0.4)
    peer.told(1)
    transport.send(COMMAND)
    with pytest.raises(CameraTimeoutError, match="no answer for 0 s: switch"):
        transport.receive()
    told = peer.told(1)
    transport.close()
    peer.close()
    assert told == encode_packet(PacketType.CANCEL, b"\5\0\0\0") + encode_packet(
        PacketType.PROBE_REQUEST
    )


def test_a_camera_that_gave_no_answer_is_asked_for_none_when_it_is_let_go(clock: Clock) -> None:
    """Nor waited for once more: hanging up ends its session."""
    opened = encode_packet(PacketType.RESPONSE, struct.pack("<HI", 0x2001, 0))
    transport, peer = meeting(opened, answer_s=0.4)
    peer.told(0)
    session = Session(transport, clock)
    session.open()
    with pytest.raises(CameraTimeoutError):
        session.request(Operation.GET_STORAGE_IDS)
    session.close()
    told = b""
    while more := peer.told(0):
        told += more
    peer.close()
    codes = Operation.OPEN_SESSION, Operation.GET_STORAGE_IDS
    expected = (
        struct.pack("<IIIHII", 22, 6, 1, codes[0], 0, 1),
        struct.pack("<IIIHI", 18, 6, 1, codes[1], 1),
    )
    assert told == b"".join(expected)


@pytest.mark.parametrize("untold", [False, True])
@pytest.mark.parametrize(("room", "data_s"), [(100_000, 2), (None, 4)])
def test_data_have_time_by_what_was_asked_for(
    untold: bool, room: int | None, data_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    deadlines, read_into = set[float](), PacketStream.read_into

    def noting(stream: PacketStream, view: memoryview, deadline: float) -> None:
        deadlines.add(deadline)
        read_into(stream, view, math.inf)

    start = UNTOLD if untold else START
    end = encode_packet(PacketType.END_DATA, b"\5\0\0\0", b"photograph")
    transport, peer = meeting(start + end)
    transport.send(COMMAND)
    monkeypatch.setattr(PacketStream, "read_into", noting)
    monkeypatch.setattr("drivers.ptp.ip.time", SimpleNamespace(monotonic=lambda: 1000.0))
    into = None if room is None else memoryview(bytearray(room))
    assert bytes(transport.receive(200_000, into).payload) == b"photograph"
    transport.close()
    peer.close()
    assert deadlines == {1010, 1010 + data_s}  # of its answer and of the rest


@pytest.mark.parametrize(
    ("reason", "sentence"), [(1, "turned this computer away"), (2, "in use"), (9, "no connection")]
)
def test_a_camera_that_takes_no_connection_says_why(reason: int, sentence: str) -> None:
    peer = Peer(encode_packet(PacketType.INIT_FAIL, struct.pack("<I", reason)))
    with pytest.raises(CameraBusyError, match=sentence):
        IpTransport("127.0.0.1", peer.port, answer_s=10)
    peer.close()


@pytest.mark.parametrize(
    ("address", "place"),
    [
        ("ptp+ip://camera", ("camera", 15740)),
        ("ptp+ip://10.0.0.9:15741/", ("10.0.0.9", 15741)),
        ("ptp+ip://[fe80::1]:9", ("fe80::1", 9)),
    ],
)
def test_addresses_are_read(address: str, place: tuple[str, int]) -> None:
    assert parse(address) == place


@pytest.mark.parametrize(
    "address",
    [
        "ptp+ip://",
        "ptp+ip://host:0",
        "ptp+ip://host:65536",
        "ptp+ip://host:port",
        "ptp+ip://host/path",
        "ptp+ip://host?query",
        "ptp+ip://user@host",
        "ptp+ip://[host",
        "ptp+ip://ho\x1bst",
    ],
)
def test_addresses_that_are_none_are_refused(address: str) -> None:
    with pytest.raises(BadAddressError, match="no address of a camera on the network"):
        check_address(address)
