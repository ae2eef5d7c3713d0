"""ZIP files written while they are sent."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import IO, cast


@dataclass(frozen=True)
class Member:
    """One file: its name, its size in bytes, and how to get its bytes."""

    name: str
    size: int
    chunks: Callable[[], Iterable[bytes]]


class _Outbox:
    """Takes what zipfile writes, to be handed on."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, data: bytes) -> int:
        self._parts.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Nothing to do: take() hands on."""

    def take(self) -> bytes:
        data = b"".join(self._parts)
        self._parts.clear()
        return data


def stored_zip(members: Iterable[Member]) -> Iterator[bytes]:
    """Write a ZIP of the members, uncompressed since photographs are compressed already.

    Raises ValueError for a name that could lead out of the folder it is unpacked in.
    """
    outbox = _Outbox()
    with zipfile.ZipFile(cast(IO[bytes], outbox), "w", zipfile.ZIP_STORED) as archive:
        for member in members:
            if not member.name.strip(".") or set(member.name) & set("/\\\0"):
                raise ValueError(f"{member.name!r} is no name of a file")
            info = zipfile.ZipInfo(member.name)  # of 1980: equal files make equal ZIPs
            info.file_size = member.size  # so that files over 4 GiB get the larger headers
            with archive.open(info, "w") as file:
                for chunk in member.chunks():
                    file.write(chunk)
                    yield outbox.take()
        yield outbox.take()
    yield outbox.take()
