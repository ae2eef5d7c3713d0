"""Numbers, strings and arrays of PTP datasets. Source: ISO 15740, clause 5.3 (little endian)."""

from __future__ import annotations

import struct
from collections.abc import Iterable

from drivers.errors import ProtocolError
from drivers.ptp.containers import Bytes

_FORMATS = {1: "<B", 2: "<H", 4: "<I", 8: "<Q"}


class Reader:
    """Reads a dataset from its start; every method raises ProtocolError where bytes are missing."""

    def __init__(self, data: Bytes) -> None:
        self._data = bytes(data)
        self._at = 0

    def take(self, count: int) -> bytes:
        """Take the next count bytes."""
        taken = self._data[self._at : self._at + count]
        if len(taken) < count:
            raise ProtocolError(f"A PTP dataset of {len(self._data)} bytes ends too early")
        self._at += count
        return taken

    def uint(self, width: int) -> int:
        """Read an unsigned number of 1, 2, 4 or 8 bytes."""
        return int(struct.unpack(_FORMATS[width], self.take(width))[0])

    def uints(self, width: int) -> tuple[int, ...]:
        """Read an array: u32 count, then numbers."""
        count = self.uint(4)
        return self.plain_uints(width, count)

    def plain_uints(self, width: int, count: int) -> tuple[int, ...]:
        """Read numbers without a count before them."""
        data = self.take(width * count)
        return struct.unpack(f"<{count}{_FORMATS[width][1]}", data)

    def string(self) -> str:
        """Read a string: u8 count of UTF-16 units with the closing zero, then the units.

        It ends at its first zero: what a camera leaves behind that is none of it.
        """
        data = self.take(2 * self.uint(1))
        ends = (at for at in range(0, len(data), 2) if data[at : at + 2] == b"\0\0")
        try:
            return data[: next(ends, None)].decode("utf-16-le")
        except UnicodeDecodeError as error:
            raise ProtocolError("A PTP string is not valid UTF-16") from error


def uint(value: int, width: int) -> bytes:
    """Write an unsigned number of 1, 2, 4 or 8 bytes."""
    return struct.pack(_FORMATS[width], value)


def uints(values: Iterable[int], width: int) -> bytes:
    """Write an array: u32 count, then numbers."""
    listed = list(values)
    return uint(len(listed), 4) + b"".join(uint(value, width) for value in listed)


def string(text: str) -> bytes:
    """Write a string of at most 254 UTF-16 units."""
    if not text:
        return b"\0"
    units = (text + "\0").encode("utf-16-le")
    return uint(len(units) // 2, 1) + units
