from __future__ import annotations

import struct

import pytest

from drivers.errors import ProtocolError
from drivers.ptp import containers
from drivers.ptp.codes import ContainerType, Operation
from drivers.ptp.containers import Container


def test_a_command_has_the_bytes_of_the_standard() -> None:
    command = Container.with_parameters(ContainerType.COMMAND, Operation.OPEN_SESSION, 7, (1, 2))
    assert command.encode() == bytes.fromhex("14000000 0100 0210 07000000 01000000 02000000")


@pytest.mark.parametrize("kind", ContainerType)
@pytest.mark.parametrize("count", [0, 1, 5])
def test_what_is_written_is_read_again(kind: ContainerType, count: int) -> None:
    parameters = tuple(range(0xFFFFFFFB, 0xFFFFFFFB + count))
    container = Container.with_parameters(kind, 0x1001, 0xFFFFFFFE, parameters)
    assert containers.decode(container.encode()) == container
    assert container.parameters == parameters


def test_data_may_have_any_length() -> None:
    data = Container(ContainerType.DATA, 0x1009, 3, b"\x00" * 23)
    assert containers.decode(data.encode()) == data


@pytest.mark.parametrize(
    ("raw", "complaint"),
    [
        (b"", "at least 12 bytes, but 0 came"),
        (b"\x0c\x00\x00\x00\x03\x00\x01\x20\x00\x00\x00", "at least 12 bytes, but 11 came"),
        (struct.pack("<IHHI", 13, 3, 0x2001, 0), "says 13 bytes, but 12 came"),
        (struct.pack("<IHHI", 11, 3, 0x2001, 0), "says 11 bytes, but 12 came"),
        (struct.pack("<IHHI", 0, 3, 0x2001, 0), "says 0 bytes, but 12 came"),
        (struct.pack("<IHHI", 0xFFFFFFFF, 3, 0x2001, 0), "says 4294967295 bytes, but 12 came"),
        (struct.pack("<IHHI", 12, 0, 0x2001, 0), "unknown type 0"),
        (struct.pack("<IHHI", 12, 5, 0x2001, 0), "unknown type 5"),
        (struct.pack("<IHHI", 13, 3, 0x2001, 0) + b"\0", "1 bytes are not"),
        (struct.pack("<IHHI", 36, 3, 0x2001, 0) + b"\0" * 24, "24 bytes are not"),
    ],
)
def test_malformed_containers_are_refused(raw: bytes, complaint: str) -> None:
    with pytest.raises(ProtocolError, match=complaint):
        containers.decode(raw)
