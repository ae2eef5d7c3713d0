"""Datasets: what operations answer with. Source: ISO 15740, clauses 5.5 and 13.3."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from drivers.errors import ProtocolError, SettingError
from drivers.ptp.codes import DataType
from drivers.ptp.containers import Bytes
from drivers.ptp.wire import Reader, string, uint, uints

_WIDTHS = {DataType.UINT8: 1, DataType.UINT16: 2, DataType.UINT32: 4}


class Form(IntEnum):
    """How a property lists its values."""

    NONE = 0
    RANGE = 1
    ENUMERATION = 2


@dataclass(frozen=True)
class DeviceInfo:
    """Who the device is and what it can do. vendor: whose extensions it speaks, 0 for none."""

    operations: tuple[int, ...]
    events: tuple[int, ...]
    properties: tuple[int, ...]
    formats: tuple[int, ...]
    manufacturer: str
    model: str
    version: str
    serial: str
    vendor: int = 0

    def encode(self) -> bytes:
        """As bytes on the wire, PTP version 1.00."""
        return b"".join(
            (
                uint(100, 2),
                uint(self.vendor, 4),
                uint(100 if self.vendor else 0, 2),
                string(""),
                uint(0, 2),
                uints(self.operations, 2),
                uints(self.events, 2),
                uints(self.properties, 2),
                uints(self.formats, 2),
                uints(self.formats, 2),
                string(self.manufacturer),
                string(self.model),
                string(self.version),
                string(self.serial),
            )
        )

    @classmethod
    def decode(cls, data: Bytes) -> DeviceInfo:
        """Read it. Raises ProtocolError for bytes that are no DeviceInfo."""
        reader = Reader(data)
        reader.uint(2)  # PTP version
        vendor = reader.uint(4)
        reader.uint(2)  # version of the vendor's extension
        reader.string()
        reader.uint(2)  # functional mode
        operations, events, properties, formats = (reader.uints(2) for _ in range(4))
        reader.uints(2)  # image formats
        return cls(
            operations,
            events,
            properties,
            formats,
            manufacturer=reader.string(),
            model=reader.string(),
            version=reader.string(),
            serial=reader.string(),
            vendor=vendor,
        )


UNKNOWN_BYTES = 0xFFFFFFFFFFFFFFFF
"""What a camera tells that does not know the room on its card."""


@dataclass(frozen=True)
class StorageInfo:
    """A memory card. capacity and free: bytes; free_images: photographs that still fit."""

    capacity: int
    free: int
    free_images: int
    label: str

    def encode(self) -> bytes:
        """As bytes on the wire: removable RAM, DCF file system, read and write."""
        return b"".join(
            (
                uint(4, 2),
                uint(3, 2),
                uint(0, 2),
                uint(self.capacity, 8),
                uint(self.free, 8),
                uint(self.free_images, 4),
                string(self.label),
                string(""),
            )
        )

    @classmethod
    def decode(cls, data: Bytes) -> StorageInfo:
        """Read it. Raises ProtocolError for bytes that are no StorageInfo."""
        reader = Reader(data)
        reader.take(6)  # kinds of card, file system and access
        return cls(reader.uint(8), reader.uint(8), reader.uint(4), reader.string())


@dataclass(frozen=True)
class ObjectInfo:
    """A file or folder on the card. size: bytes. captured: YYYYMMDDThhmmss or empty."""

    storage: int
    format: int
    size: int
    width: int
    height: int
    parent: int
    name: str
    captured: str

    def encode(self) -> bytes:
        """As bytes on the wire, without thumbnail."""
        return b"".join(
            (
                uint(self.storage, 4),
                uint(self.format, 2),
                uint(0, 2),
                uint(self.size, 4),
                uint(0, 2),
                uint(0, 4) * 3,
                uint(self.width, 4),
                uint(self.height, 4),
                uint(24, 4),
                uint(self.parent, 4),
                uint(0, 2),
                uint(0, 4) * 2,
                string(self.name),
                string(self.captured),
                string(self.captured),
                string(""),
            )
        )

    @classmethod
    def decode(cls, data: Bytes) -> ObjectInfo:
        """Read it. Raises ProtocolError for bytes that are no ObjectInfo."""
        reader = Reader(data)
        storage, kind = reader.uint(4), reader.uint(2)
        reader.uint(2)  # protection
        size = reader.uint(4)
        reader.take(14)  # thumbnail
        width, height = reader.uint(4), reader.uint(4)
        reader.uint(4)  # bit depth
        parent = reader.uint(4)
        reader.take(10)  # kind of folder, sequence number
        name, captured = reader.string(), reader.string()
        return cls(storage, kind, size, width, height, parent, name, captured)


@dataclass(frozen=True)
class PropertyDescription:
    """A device property: its value now, by default, and what it may be.

    values: every value for Form.ENUMERATION; minimum, maximum, step for Form.RANGE.
    """

    code: int
    type: DataType
    writable: bool
    default: int
    current: int
    form: Form = Form.NONE
    values: tuple[int, ...] = ()

    @property
    def width(self) -> int:
        """Bytes of a value."""
        return _WIDTHS[self.type]

    def encode(self) -> bytes:
        """As bytes on the wire."""
        width = _WIDTHS[self.type]
        count = uint(len(self.values), 2) if self.form is Form.ENUMERATION else b""
        return b"".join(
            (
                uint(self.code, 2),
                uint(self.type, 2),
                uint(self.writable, 1),
                uint(self.default, width),
                uint(self.current, width),
                uint(self.form, 1),
                count,
                *(uint(value, width) for value in self.values),
            )
        )

    @classmethod
    def decode(cls, data: Bytes) -> PropertyDescription:
        """Read it. Raises ProtocolError for bytes that describe no property, else like width_of."""
        reader = Reader(data)
        code, type_code, writable = reader.uint(2), reader.uint(2), reader.uint(1)
        width = width_of(type_code)
        default, current, form = reader.uint(width), reader.uint(width), reader.uint(1)
        if form == Form.ENUMERATION:
            values = reader.plain_uints(width, reader.uint(2))
        elif form == Form.RANGE:
            values = reader.plain_uints(width, 3)
        elif form == Form.NONE:
            values = ()
        else:
            raise ProtocolError(f"PTP property {code:#06x} has the unknown form {form}")
        return cls(code, DataType(type_code), writable == 1, default, current, Form(form), values)


def width_of(type_code: int) -> int:
    """Bytes of a property value. Raises SettingError for types that no setting here has."""
    try:
        return _WIDTHS[DataType(type_code)]
    except ValueError as error:
        raise SettingError(
            f"The camera has a setting of the PTP data type {type_code:#06x}, which is not known "
            "here: set it on the camera itself."
        ) from error
