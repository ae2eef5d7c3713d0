from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime

import pytest

from service.retry_after import retry_after


def test_it_may_be_a_date() -> None:
    date = format_datetime(datetime.now(UTC) + timedelta(hours=1), usegmt=True)
    assert 3590 < retry_after(date) <= 3600
    assert retry_after("Wed, 21 Oct 2015 07:28:00 GMT") == 0.0
    far = f"Fri, 31 Dec 9999 23:59:59 +{'9' * 30}"
    assert [retry_after(text) for text in ("", "-5", "soon", "²", "1.5", far)] == [0.0] * 6


@pytest.mark.parametrize("zone", ["GMT", "-0000", ""])
def test_a_date_of_no_zone_is_in_utc(zone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    try:
        date = f"{datetime.now(UTC) + timedelta(hours=1):%a, %d %b %Y %H:%M:%S} {zone}"
        assert 3590 < retry_after(date) <= 3600
    finally:
        monkeypatch.undo()
        time.tzset()
