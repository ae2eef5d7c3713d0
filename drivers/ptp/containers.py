"""Containers: the envelopes of the Picture Transfer Protocol. Source: ISO 15740, annex D."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from drivers.errors import ProtocolError
from drivers.ptp.codes import ContainerType

_HEADER = struct.Struct("<IHHI")
_MAX_PARAMETERS = 5

Bytes = bytes | bytearray | memoryview
"""Bytes that need not be copied to be handed on."""


@dataclass(frozen=True)
class Container:
    """One envelope: type, operation/response/event code, transaction id and what is in it."""

    type: ContainerType
    code: int
    transaction: int
    payload: Bytes = b""

    @classmethod
    def with_parameters(
        cls, kind: ContainerType, code: int, transaction: int, parameters: tuple[int, ...]
    ) -> Container:
        """Make a command, response or event; at most five parameters of 32 bits."""
        return cls(kind, code, transaction, struct.pack(f"<{len(parameters)}I", *parameters))

    @property
    def parameters(self) -> tuple[int, ...]:
        """The payload of a command, response or event as numbers."""
        return struct.unpack(f"<{len(self.payload) // 4}I", self.payload)

    def encode(self) -> bytes:
        """Write the bytes on the wire: u32 length, u16 type, u16 code, u32 transaction, payload."""
        length = _HEADER.size + len(self.payload)
        return _HEADER.pack(length, self.type, self.code, self.transaction) + bytes(self.payload)


def decode(raw: bytes | bytearray) -> Container:
    """Read a container. Raises ProtocolError for bytes that are none."""
    if len(raw) < _HEADER.size:
        raise ProtocolError(f"A PTP container has at least 12 bytes, but {len(raw)} came")
    length, kind, code, transaction = _HEADER.unpack_from(raw)
    if length != len(raw):
        raise ProtocolError(f"A PTP container says {length} bytes, but {len(raw)} came")
    if kind not in list(ContainerType):
        raise ProtocolError(f"A PTP container is of the unknown type {kind}")
    payload = raw[_HEADER.size :]
    if kind != ContainerType.DATA and (len(payload) % 4 or len(payload) > 4 * _MAX_PARAMETERS):
        raise ProtocolError(f"{len(payload)} bytes are not up to five PTP parameters of 32 bits")
    return Container(ContainerType(kind), code, transaction, payload)
