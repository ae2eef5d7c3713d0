from __future__ import annotations

import pytest

from service.api.ranges import parse_range
from service.errors import RangeError


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (None, None),
        ("", None),
        ("bytes=0-0", (0, 1)),
        ("bytes=0-9", (0, 10)),
        ("bytes=2-", (2, 10)),
        ("bytes=2-99", (2, 10)),
        ("bytes=-3", (7, 10)),
        ("bytes=-99", (0, 10)),
        (" bytes = 4 - 5 ", (4, 6)),
        ("bytes=5-4", None),
        ("bytes=-", None),
        ("bytes=0-1,4-5", None),
        ("lines=0-1", None),
        ("bytes=a-b", None),
        ("bytes=0-" + "9" * 30, None),
    ],
)
def test_a_range_of_ten_bytes(header: str | None, expected: tuple[int, int] | None) -> None:
    assert parse_range(header, 10) == expected


@pytest.mark.parametrize("header", ["bytes=10-", "bytes=10-20", "bytes=-0"])
def test_a_range_that_begins_after_the_end_is_refused(header: str) -> None:
    with pytest.raises(RangeError, match="10 bytes") as caught:
        parse_range(header, 10)
    assert caught.value.size == 10


def test_an_empty_file_has_no_range() -> None:
    assert parse_range(None, 0) is None
    with pytest.raises(RangeError):
        parse_range("bytes=0-", 0)
