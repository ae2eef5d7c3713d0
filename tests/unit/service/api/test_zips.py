from __future__ import annotations

import io
import zipfile
from functools import partial

from service.api.zips import Member, stored_zip


def _zip(files: dict[str, list[bytes]]) -> bytes:
    members = [
        Member(name, sum(map(len, chunks)), partial(iter, chunks)) for name, chunks in files.items()
    ]
    return b"".join(stored_zip(members))


def test_members_come_back_whole_and_in_order() -> None:
    made = _zip({"manifest.json": [b"{", b"}"], "lamp1.jpg": [b"x" * 70_000, b"y"], "e": []})
    with zipfile.ZipFile(io.BytesIO(made)) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["manifest.json", "lamp1.jpg", "e"]
        assert archive.read("manifest.json") == b"{}"
        assert archive.read("lamp1.jpg") == b"x" * 70_000 + b"y"
        assert archive.read("e") == b""
        assert {item.compress_type for item in archive.infolist()} == {zipfile.ZIP_STORED}


def test_equal_files_make_equal_zips() -> None:
    assert _zip({"a": [b"12", b"3"]}) == _zip({"a": [b"1", b"23"]})


def test_no_member_is_held_back_until_the_end() -> None:
    parts = stored_zip([Member("a", 2, lambda: [b"1", b"2"])])
    assert next(parts).endswith(b"1")
    assert next(parts) == b"2"


def test_members_over_4_gib_get_the_larger_headers() -> None:
    head = next(stored_zip([Member("a", 5 * 2**30, lambda: [b"1"])]))
    assert head[4:6] == b"\x2d\0"  # needs version 4.5 of the format, ZIP64


def test_an_empty_zip_is_a_zip() -> None:
    with zipfile.ZipFile(io.BytesIO(_zip({}))) as archive:
        assert archive.namelist() == []
