"""A store that is a folder of this machine, or of a file system that its hosts share."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import obstore
from obstore.exceptions import GenericError
from obstore.store import LocalStore

from service import durable
from service.storage.base import PIECES, Storage, chunks_of, room


class FolderStorage(Storage):
    """Objects as files. It keeps no headers, for it gives no links."""

    def __init__(self, folder: Path) -> None:
        """Open the store in a folder, which is made when it is missing."""
        super().__init__(LocalStore(folder, mkdir=True, automatic_cleanup=True))
        self._folder = folder

    def put(
        self,
        key: str,
        data: bytes | Path,
        headers: Mapping[str, str] | None = None,  # noqa: ARG002
        check: Callable[[], None] = lambda: None,  # noqa: ARG002
    ) -> None:
        """Store bytes or a file. Raises StorageFullError."""
        with self._puts, room():
            obstore.put(self._store, key, data, max_concurrency=PIECES)

    def flush(self, keys: Iterable[str]) -> None:
        """Return once these objects would outlast a power cut. Raises GenericError."""
        paths: set[Path] = set()
        for key in keys:
            path = self._folder / key
            paths.add(path)
            paths.update(parent for parent in path.parents if parent.is_relative_to(self._folder))
        try:
            for path in paths:  # a file's name is kept by its folder
                durable.flush(path)
        except OSError as error:
            raise GenericError("the disk does not keep what was stored") from error

    def stream(self, key: str, start: int, end: int) -> Iterator[bytes]:
        """Read bytes start…end−1 of an object, in chunks. Raises FileNotFoundError at once."""
        if start == end:
            return iter(())
        return chunks_of(obstore.get(self._store, key, options={"range": (start, end)}))

    def link(self, key: str, seconds: float) -> str | None:  # noqa: ARG002
        """Give none: nobody answers for a folder."""
        return None

    def changed(self, prefix: str) -> float:
        """When anything below prefix was last stored, in seconds since 1970; 0 without any.

        What is being stored counts too, though it is no object yet.
        """
        return _newest(self._folder / prefix)

    def delete_below(self, prefix: str) -> None:
        """Delete every object below prefix, which ends with a slash; others may do so as well."""
        for key in self.list(prefix):
            self.delete(key)
        # A process that was killed while it stored something has left a file that is no object.
        shutil.rmtree(self._folder / prefix, ignore_errors=True)

    def free_bytes(self) -> int:
        """Tell how much more fits on the disk. Raises GenericError."""
        return _disk(self._folder)[1]

    def disk_bytes(self) -> int:
        """Tell how large the disk is. Raises GenericError."""
        return _disk(self._folder)[0]


def _disk(folder: Path) -> tuple[int, int]:
    """Size of a folder's disk and what of it is free, in bytes. Raises GenericError."""
    try:
        usage = shutil.disk_usage(folder)
        return usage.total, usage.free
    except OSError as error:
        raise GenericError("the disk does not tell its free space") from error


def _newest(folder: Path) -> float:
    """When a folder or anything in it was last written, in seconds since 1970; 0 without it."""
    newest = 0.0
    for parent, _, names in os.walk(folder):
        for path in (Path(parent), *(Path(parent, name) for name in names)):
            with contextlib.suppress(FileNotFoundError):  # stored or deleted at this moment
                newest = max(newest, path.stat().st_mtime)
    return newest
