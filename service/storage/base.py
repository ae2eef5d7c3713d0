"""What every store can do, and how it tells what is wrong with it."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import obstore
from obstore.exceptions import BaseError, GenericError
from obstore.store import ObjectStore

from service.durable import FULL
from service.errors import StorageFullError

PIECES = 2
"""Of a large file in memory at a time, of 5 MiB, not a dozen."""

_CHUNK_BYTES = 1024 * 1024
_PUTS = 4  # at a time, whatever number of threads stores: each holds pieces in memory
_FULL_SIGNS = (*(f"(os error {number})" for number in FULL), "507 Insufficient Storage")
"""What the store's client says of a disk that is full: this machine's, or that of an S3 server."""


class Storage(ABC):
    """Objects by key. Keys are paths with forward slashes; puts are atomic."""

    def __init__(self, store: ObjectStore) -> None:
        """store: the client of obstore."""
        self._store = store
        self._puts = threading.Semaphore(_PUTS)

    @abstractmethod
    def put(
        self,
        key: str,
        data: bytes | Path,
        headers: Mapping[str, str] | None = None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Store bytes, or a file in parts when it is large. Raises StorageFullError.

        headers: what the answer to a link has, like Content-Type. check: asked each second where
        a put may take long; what it raises ends that.
        """

    def put_file(
        self,
        key: str,
        path: Path,
        headers: Mapping[str, str] | None = None,
        check: Callable[[], None] = lambda: None,
    ) -> str:
        """Store a file as put does, and give back its SHA-256."""
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        self.put(key, path, headers, check)
        return digest

    def copy(self, key: str, other: str) -> None:
        """Copy an object; neither is hurt when the other is deleted.

        Raises FileNotFoundError, StorageFullError.
        """
        with self._reading(), room():
            obstore.copy(self._store, key, other)

    def size(self, key: str) -> int:
        """Tell how many bytes an object has. Raises FileNotFoundError."""
        with self._reading():
            return int(obstore.head(self._store, key)["size"])

    @abstractmethod
    def flush(self, keys: Iterable[str]) -> None:
        """Return once these objects would outlast a power cut. Raises GenericError."""

    def get(self, key: str) -> bytes:
        """Read an object's bytes. Raises FileNotFoundError."""
        with self._reading():
            return bytes(obstore.get(self._store, key).bytes())

    def get_file(self, key: str, path: Path) -> None:
        """Write an object to a file. Raises FileNotFoundError."""
        with path.open("wb") as file:
            for chunk in self.chunks(key):
                file.write(chunk)

    def chunks(self, key: str) -> Iterator[bytes]:
        """Read an object piece by piece. Raises FileNotFoundError at once."""
        with self._reading():
            return chunks_of(obstore.get(self._store, key))

    @abstractmethod
    def stream(self, key: str, start: int, end: int) -> Iterator[bytes]:
        """Read bytes start…end−1 of an object, in chunks. Raises FileNotFoundError at once."""

    @abstractmethod
    def link(self, key: str, seconds: float) -> str | None:
        """Sign a URL that reads an object without a password, for a time; None for a folder.

        Its answer has the headers that the object was put with.
        Raises GenericError without credentials to sign with.
        """

    def folders(self, prefix: str) -> list[str]:
        """List the names right below prefix, which ends with a slash, that have more below them."""
        found = obstore.list_with_delimiter(self._store, prefix=prefix)["common_prefixes"]
        return sorted(path.rpartition("/")[2] for path in found)

    def list(self, prefix: str) -> list[str]:
        """List every key below prefix, sorted."""
        found = obstore.list(self._store, prefix=prefix)
        return sorted(item["path"] for batch in found for item in batch)

    def delete(self, key: str) -> None:
        """Delete an object, unless it is gone already."""
        with contextlib.suppress(FileNotFoundError):
            obstore.delete(self._store, key)

    @abstractmethod
    def changed(self, prefix: str) -> float:
        """When anything below prefix was last stored, in seconds since 1970; 0 without any."""

    @abstractmethod
    def delete_below(self, prefix: str) -> None:
        """Delete every object below prefix, which ends with a slash; others may do so as well."""

    def try_delete_below(self, prefix: str) -> bool:
        """Do what delete_below does; false when something there is not ours to delete.

        Raises what check raises when the store as a whole is away.
        """
        try:
            self.delete_below(prefix)
        except (BaseError, OSError):
            self.check()
            return False
        return True

    @abstractmethod
    def free_bytes(self) -> int | None:
        """Tell how much more fits on the disk, None for S3. Raises GenericError."""

    @abstractmethod
    def disk_bytes(self) -> int | None:
        """Tell how large the disk is, None for S3. Raises GenericError."""

    def check(self) -> None:
        """Ask the store for something. Raises what the store's client raises when it is away."""
        next(iter(obstore.list(self._store, prefix="health", chunk_size=1)), None)

    async def check_within(self, seconds: float) -> None:
        """Do what check() does, in no thread, for so long at most. Raises GenericError then."""
        try:
            async with asyncio.timeout(seconds):
                found = obstore.list(self._store, prefix="health", chunk_size=1)
                await anext(aiter(found), None)
        except TimeoutError as error:
            raise GenericError(f"no answer within {seconds:g} s") from error

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        """Raise FileNotFoundError in the block where an object is gone, and for nothing else."""
        yield


def chunks_of(found: obstore.GetResult) -> Iterator[bytes]:
    """Read on what a request for an object gives."""
    return (bytes(chunk) for chunk in found.stream(min_chunk_size=_CHUNK_BYTES))


@contextlib.contextmanager
def room() -> Iterator[None]:
    """Tell a full disk from a store that is away, which the store's client does in words alone."""
    try:
        yield
    except GenericError as error:
        if any(sign in str(error) for sign in _FULL_SIGNS):
            raise StorageFullError(
                "The disk that photographs and results are kept on is full; try again later."
            ) from error
        raise
