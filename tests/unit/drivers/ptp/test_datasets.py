from __future__ import annotations

import pytest

from drivers.errors import ProtocolError, SettingError
from drivers.ptp.codes import DataType, Property
from drivers.ptp.datasets import DeviceInfo, Form, ObjectInfo, PropertyDescription, StorageInfo
from drivers.ptp.wire import Reader, string, uint, uints

DEVICE = DeviceInfo((0x1001, 0x1002), (0x4002,), (0x5007,), (0x3811,), "Make", "Model é", "1", "")
OBJECT = ObjectInfo(0x10001, 0x3811, 123_456, 1200, 800, 1, "DSC_0001.DNG", "20240229T235958")
FLASH = PropertyDescription(
    Property.FLASH_MODE, DataType.UINT16, True, 3, 2, Form.ENUMERATION, (2, 3, 5)
)


@pytest.mark.parametrize("width", [1, 2, 4, 8])
def test_numbers_are_little_endian(width: int) -> None:
    value = int.from_bytes(range(1, width + 1), "little")
    assert uint(value, width) == bytes(range(1, width + 1))
    assert Reader(uint(value, width)).uint(width) == value


@pytest.mark.parametrize(
    ("text", "raw"),
    [("", b"\0"), ("A", b"\x02A\0\0\0"), ("é€", b"\x03\xe9\x00\xac\x20\x00\x00")],
)
def test_strings_are_counted_utf16_with_a_closing_zero(text: str, raw: bytes) -> None:
    assert string(text) == raw
    assert Reader(raw).string() == text


def test_arrays_are_counted() -> None:
    assert uints([1, 2], 2) == b"\x02\0\0\0\x01\0\x02\0"
    assert Reader(uints([5, 6, 7], 4)).uints(4) == (5, 6, 7)


@pytest.mark.parametrize("raw", [b"\x03A\0B\0", b"\x02A", b"\xff", b""])
def test_a_string_that_ends_too_early_is_refused(raw: bytes) -> None:
    with pytest.raises(ProtocolError, match="ends too early"):
        Reader(raw).string()


def test_a_string_ends_at_its_first_zero() -> None:
    assert Reader(b"\x05A\0B\0\0\0x\0y\0").string() == "AB"
    assert Reader(b"\x04A\0\0\0\x00\xd8\0\0").string() == "A"  # behind it half a character
    assert Reader(b"\x04\x00\x01\x01\0\0\0B\0").string() == "\u0100\u0001"
    assert Reader(b"\x02A\0B\0").string() == "AB"


def test_a_string_of_broken_surrogates_is_refused() -> None:
    with pytest.raises(ProtocolError, match="not valid UTF-16"):
        Reader(b"\x02\x00\xd8A\x00").string()


@pytest.mark.parametrize("count", [2, 0x7FFFFFFF, 0xFFFFFFFF])
def test_an_array_longer_than_its_dataset_is_refused(count: int) -> None:
    with pytest.raises(ProtocolError, match="of 8 bytes ends too early"):
        Reader(uint(count, 4) + uint(1, 4)).uints(4)


def test_device_info_is_read_again() -> None:
    assert DeviceInfo.decode(DEVICE.encode()) == DEVICE


def test_object_info_has_the_length_of_the_standard() -> None:
    fixed, strings = 52, (1 + 2 * 13) + 2 * (1 + 2 * 16) + 1
    assert len(OBJECT.encode()) == fixed + strings
    assert ObjectInfo.decode(OBJECT.encode()) == OBJECT


@pytest.mark.parametrize(
    "description",
    [
        FLASH,
        PropertyDescription(Property.EXPOSURE_TIME, DataType.UINT32, False, 200, 100),
        PropertyDescription(
            Property.BATTERY_LEVEL, DataType.UINT8, False, 100, 50, Form.ENUMERATION, ()
        ),
    ],
)
def test_property_descriptions_are_read_again(description: PropertyDescription) -> None:
    assert PropertyDescription.decode(description.encode()) == description


def test_a_range_is_read_as_its_three_numbers() -> None:
    raw = b"\x07\x50\x04\x00\x01" + uint(800, 2) + uint(560, 2) + b"\x01"
    raw += uint(280, 2) + uint(2200, 2) + uint(10, 2)
    description = PropertyDescription.decode(raw)
    assert description.form is Form.RANGE
    assert description.values == (280, 2200, 10)


def test_an_unknown_form_is_refused() -> None:
    with pytest.raises(ProtocolError, match="0x5007 has the unknown form 9"):
        PropertyDescription.decode(b"\x07\x50\x04\x00\x01" + bytes(4) + b"\x09")


def test_a_property_that_is_no_number_is_refused() -> None:
    with pytest.raises(SettingError, match=r"data type 0xffff.*: set it on the camera itself"):
        PropertyDescription.decode(b"\x07\x50\xff\xff\x01" + bytes(8))


def test_every_cut_of_a_dataset_is_refused() -> None:
    for whole, decode in (
        (DEVICE.encode(), DeviceInfo.decode),
        (FLASH.encode(), PropertyDescription.decode),
    ):
        for length in range(len(whole)):
            with pytest.raises(ProtocolError, match="ends too early"):
                decode(whole[:length])
    for length in range(len(OBJECT.encode()) - 34):  # what follows is not needed
        with pytest.raises(ProtocolError, match="ends too early"):
            ObjectInfo.decode(OBJECT.encode()[:length])


def test_a_card_is_read_as_it_was_written() -> None:
    card = StorageInfo(capacity=64 * 10**9, free=2**40 + 7, free_images=1234, label="studio é")
    assert StorageInfo.decode(card.encode()) == card


@pytest.mark.parametrize("length", [0, 5, 6, 21, 25])
def test_a_card_that_ends_too_early_is_refused(length: int) -> None:
    with pytest.raises(ProtocolError, match="ends too early"):
        StorageInfo.decode(StorageInfo(1, 1, 1, "").encode()[:length])
