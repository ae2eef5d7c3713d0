"""The Range header (RFC 9110, section 14)."""

from __future__ import annotations

import re

from service.errors import RangeError


def parse_range(header: str | None, size: int) -> tuple[int, int] | None:
    """First byte and byte after the last that the header asks for; None for the whole file.

    A header that is malformed or asks for several ranges is ignored, as the RFC allows. Raises
    RangeError where the range begins after the end of a file of `size` bytes.
    """
    match = re.fullmatch(r"\s*bytes\s*=\s*(\d{0,18})\s*-\s*(\d{0,18})\s*", header or "")
    if not match or match.group(1, 2) == ("", ""):
        return None
    first, last = match.group(1, 2)
    if first and last and int(last) < int(first):
        return None
    if first:
        start, end = int(first), min(int(last) + 1 if last else size, size)
    else:
        start, end = max(size - int(last), 0), size
    if start >= end:
        raise RangeError(f"The file has {size} bytes; the range begins after them.", size)
    return start, end
