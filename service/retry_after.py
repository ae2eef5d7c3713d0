"""When a server asks to be asked again."""

from __future__ import annotations

from datetime import UTC, datetime
from email.utils import parsedate_to_datetime


def retry_after(header: str) -> float:
    """Read a Retry-After header, seconds or a date (RFC 9110, 10.2.3).

    Seconds from now; 0 for what is neither.
    """
    if header.isascii() and header.isdecimal():
        return float(header[:9])
    try:
        wanted = parsedate_to_datetime(header)
    except (ValueError, OverflowError):
        return 0.0
    if wanted.tzinfo is None:
        wanted = wanted.replace(tzinfo=UTC)
    # Not turned into UTC: there is no such date for the last hours of the year 9999.
    return max((wanted - datetime.now(UTC)).total_seconds(), 0.0)
