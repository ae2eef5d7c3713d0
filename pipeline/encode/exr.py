"""OpenEXR files written strip by strip, with the channels that they are given."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32
from pipeline.encode.half_floats import write_half
from pipeline.errors import InputError

_MAGIC = b"\x76\x2f\x31\x01\x02\0\0\0"  # and the version of the format
_NUMBERS = {np.float16: 1, np.float32: 2}  # of the types of values
_LINE_HEAD = np.dtype([("row", "<i4"), ("bytes", "<i4")])


class ExrFile:
    """An EXR written from top to bottom, some rows after the others.

    Plain scan lines: docs/decisions/0011-uncompressed-layers.md. size: (width, height). half: of
    16-bit floats, as light is written; else of 32-bit floats. Raises InputError as name_of does.
    """

    def __init__(self, path: Path, size: tuple[int, int], half: bool = False) -> None:
        name_of(path)
        self._path = path
        self._size = size
        self._type: type[np.float16] | type[np.float32] = np.float16 if half else np.float32
        self._row = 0
        self._lines = np.empty((0, 0), np.uint8)

    def write(self, pictures: dict[str, Floats32]) -> None:
        """Write the next rows.

        pictures: planes (h, W), each the channel of its name, and pictures (h, W, 3), the channels
        name.R, name.G and name.B, or R, G and B if the name is RGB; the same names each time.
        Raises ValueError for pictures of different size, OSError where nothing can be written.
        """
        channels = channels_of(pictures)
        names = sorted(channels)
        lines = self._filled([channels[name] for name in names])
        with self._path.open("ab" if self._row else "wb") as file:
            if self._row == 0:
                file.write(self._head(names, lines.shape[1]))
            file.write(lines.data)
        self._row += len(lines)

    def close(self) -> None:
        """End the file. Raises ValueError where rows are missing."""
        if self._row != self._size[1]:
            raise ValueError(f"an EXR of {self._size[1]} rows was given {self._row}")

    def _filled(self, planes: list[Floats32]) -> NDArray[np.uint8]:
        """Lines of the file (h, bytes), in memory that is used again."""
        rows, width = planes[0].shape
        values = width * np.dtype(self._type).itemsize
        if len(self._lines) < rows:
            self._lines = np.empty((rows, _LINE_HEAD.itemsize + len(planes) * values), np.uint8)
        lines = self._lines[:rows]
        head = lines[:, : _LINE_HEAD.itemsize].view(_LINE_HEAD)[:, 0]
        head["row"], head["bytes"] = np.arange(self._row, self._row + rows), len(planes) * values
        for index, plane in enumerate(planes):
            start = _LINE_HEAD.itemsize + index * values
            written = lines[:, start : start + values]
            if self._type is np.float16:
                write_half(plane, written.view(np.float16))
            else:
                written.view(np.float32)[...] = plane
        return lines

    def _head(self, names: Iterable[str], line: int) -> bytes:
        """Make the header and the table of where lines of so many bytes are."""
        width, height = self._size
        window = struct.pack("<4i", 0, 0, width - 1, height - 1)
        channels = (
            name.encode() + b"\0" + struct.pack("<iB3x2i", _NUMBERS[self._type], 0, 1, 1)
            for name in names
        )
        attributes = (
            ("channels", "chlist", b"".join(channels) + b"\0"),
            ("compression", "compression", b"\0"),
            ("dataWindow", "box2i", window),
            ("displayWindow", "box2i", window),
            ("lineOrder", "lineOrder", b"\0"),
            ("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
            ("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0)),
            ("screenWindowWidth", "float", struct.pack("<f", 1.0)),
        )
        head = _MAGIC + b"".join(
            f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value
            for name, kind, value in attributes
        )
        first = len(head) + 1 + 8 * height
        places = first + line * np.arange(height, dtype="<u8")
        return head + b"\0" + places.tobytes()


def name_of(path: Path) -> str:
    """Name of a file for OpenEXR, which crashes over one that is not UTF-8. Raises InputError."""
    name = str(path)
    try:
        name.encode()
    except UnicodeEncodeError as error:
        raise InputError(
            f"EXR files cannot be at {name!a}: the name is not UTF-8, so rename the folder."
        ) from error
    return name


def channels_of(pictures: dict[str, Floats32]) -> dict[str, Floats32]:
    """Planes (h, W) by the names of their channels, of what ExrFile takes; it says the rest."""
    if len({picture.shape[:2] for picture in pictures.values()}) != 1:
        raise ValueError("the channels of an EXR must have one size")
    channels: dict[str, Floats32] = {}
    for name, picture in pictures.items():
        if picture.ndim == 2:
            channels[name] = picture
            continue
        prefix = "" if name == "RGB" else f"{name}."
        channels |= {f"{prefix}{letter}": picture[..., k] for k, letter in enumerate("RGB")}
    return channels


def write_exr(path: Path, pictures: dict[str, Floats32]) -> None:
    """Write whole pictures, as ExrFile does. Raises what it raises."""
    height, width = next(iter(pictures.values())).shape[:2]
    file = ExrFile(path, (width, height))
    file.write(pictures)
    file.close()
