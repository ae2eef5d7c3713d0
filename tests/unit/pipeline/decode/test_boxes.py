from __future__ import annotations

import struct

import pytest

from pipeline.decode.boxes import box, boxes


def _box(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", 8 + len(content)) + name + content


def test_boxes_come_in_their_order() -> None:
    data = _box(b"ftyp", b"heic") + _box(b"free", b"") + _box(b"mdat", b"light")
    assert list(boxes(data)) == [(b"ftyp", b"heic"), (b"free", b""), (b"mdat", b"light")]
    assert box(data, b"mdat") == b"light"
    assert box(data, b"meta") == b""


def test_the_first_of_a_name_is_given() -> None:
    assert box(_box(b"free", b"1") + _box(b"free", b"2"), b"free") == b"1"


def test_sizes_of_8_bytes_and_to_the_end() -> None:
    large = struct.pack(">I4sQ", 1, b"mdat", 16 + 5) + b"light"
    last = struct.pack(">I", 0) + b"meta" + b"all of it"
    assert list(boxes(large + last)) == [(b"mdat", b"light"), (b"meta", b"all of it")]


def test_the_name_of_a_uuid_is_all_of_it() -> None:
    user = bytes(range(16))
    data = _box(b"uuid", bytes(16) + b"another") + _box(b"uuid", user + b"facts")
    assert box(data, b"uuid" + user) == b"facts"


@pytest.mark.parametrize("size", [2, 7])
def test_a_size_that_cannot_be_ends_the_boxes(size: int) -> None:
    data = _box(b"ftyp", b"heic") + struct.pack(">I", size) + b"mdat" + b"light"
    assert list(boxes(data)) == [(b"ftyp", b"heic")]


def test_what_is_cut_off_is_given_as_far_as_it_is_there() -> None:
    assert list(boxes(_box(b"mdat", b"light")[:-2] + b"")) == [(b"mdat", b"lig")]
    assert list(boxes(b"\0\0\0\x10mda")) == []
