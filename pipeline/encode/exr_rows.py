"""A part of an EXR that pipeline.encode.exr wrote, without reading the rest of it.

OpenEXR reads files alone; these lie in stores, of which ranges of bytes are read.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.images.data_window import size_of_window

_HEADER_BYTES = 4096
_AT_ONCE = 2**23  # bytes that are read in one piece
_TYPES = {1: "<f2", 2: "<f4"}  # by OpenEXR's numbers; layers were of 32 bits once


class ScanLines:
    """The channels of an EXR of 16-bit or 32-bit floats in plain scan lines.

    read: gives bytes start...end-1 of the file. Raises InputError for any other file.
    """

    def __init__(self, read: Callable[[int, int], bytes]) -> None:
        self._read = read
        try:
            attributes, end = _attributes(read(0, _HEADER_BYTES))
            box = struct.unpack("<4i", attributes["dataWindow"])
            self.channels, self._type = _channels(attributes["channels"])
            plain = attributes["compression"] == b"\0"
        except (KeyError, ValueError, IndexError, struct.error) as error:
            raise InputError("The layers are no EXR that this version wrote.") from error
        if not plain:
            raise InputError("The layers are compressed: separate the pair anew.")
        self.width, self.height = size_of_window(box[:2], box[2:])
        self._first = end + 8 * self.height
        self._line = 8 + self._type.itemsize * self.width * len(self.channels)

    def area(
        self, names: Sequence[str], left: int, top: int, width: int, height: int
    ) -> NDArray[np.float16]:
        """Read the channels of these names: (channels, height, width). It lies within the file."""
        found = np.empty((len(names), height, width), np.float16)
        places = [self.channels.index(name) for name in names]
        step = max(1, _AT_ONCE // self._line)
        for row in range(0, height, step):
            rows = min(step, height - row)
            start = self._first + (top + row) * self._line
            lines = np.frombuffer(self._read(start, start + rows * self._line), np.uint8)
            values = lines.reshape(rows, self._line)[:, 8:].view(self._type)
            values = values.reshape(rows, len(self.channels), self.width)
            part = values[:, places, left : left + width].transpose(1, 0, 2)
            found[:, row : row + rows] = np.clip(part, -65504, 65504)
        return found


def _attributes(head: bytes) -> tuple[dict[str, bytes], int]:
    """The attributes of the header by name, and where it ends."""
    if head[:4] != b"\x76\x2f\x31\x01":
        raise ValueError("no EXR")
    attributes: dict[str, bytes] = {}
    place = 8
    while head[place]:
        name_end = head.index(0, place)
        type_end = head.index(0, name_end + 1)
        (size,) = struct.unpack_from("<i", head, type_end + 1)
        start = type_end + 5
        attributes[head[place:name_end].decode()] = head[start : start + size]
        place = start + size
    return attributes, place + 1


def _channels(listed: bytes) -> tuple[list[str], np.dtype[Any]]:
    """Names of the channels as they follow each other in a line, and the type of all of them."""
    names: list[str] = []
    types: set[int] = set()
    place = 0
    while listed[place]:
        end = listed.index(0, place)
        names.append(listed[place:end].decode())
        types.add(struct.unpack_from("<i", listed, end + 1)[0])
        place = end + 17
    (only,) = types
    return names, np.dtype(_TYPES[only])
