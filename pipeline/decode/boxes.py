"""Boxes of files by ISO/IEC 14496-12 (4.2), as HEIF, JPEG XL and CR3 have them."""

from __future__ import annotations

from collections.abc import Iterator


def boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Names of boxes one after another, and what is in each, as far as it is there.

    The name of a `uuid` has its 16 bytes as well.
    """
    at = 0
    while at + 8 <= len(data):
        head, size = 8, int.from_bytes(data[at : at + 4], "big")
        if size == 1:  # the size follows the name, in 8 bytes
            head, size = 16, int.from_bytes(data[at + 8 : at + 16], "big")
        if size == 0:  # to the end
            size = len(data) - at
        if size < head:
            return
        name = data[at + 4 : at + 8]
        if name == b"uuid":
            name, head = name + data[at + head : at + head + 16], head + 16
        yield name, data[at + head : at + size]
        at += size


def box(data: bytes, name: bytes) -> bytes:
    """Give what is in the first box of that name, nothing where there is none."""
    return next((content for known, content in boxes(data) if known == name), b"")
