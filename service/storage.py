"""Where photographs and results lie: a local folder or an S3-compatible store, by URL."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import itertools
import os
import shutil
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import timedelta
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

import obstore
from obstore.exceptions import BaseError, GenericError
from obstore.store import LocalStore, ObjectStore, S3Store

from service import durable
from service.durable import FULL
from service.errors import StorageFullError

_CHUNK = 1024 * 1024
_PIECE = 4 * _CHUNK  # that a request to S3 asks for
_PUTS = 4  # at a time, whatever number of threads stores: each holds pieces in memory
_PIECES = 2  # of a large file in memory at a time, of 5 MiB, not a dozen

_FULL_SIGNS = (*(f"(os error {number})" for number in FULL), "507 Insufficient Storage")
"""What the store's client says of a disk that is full: this machine's, or that of an S3 server."""

_RETRY = timedelta(seconds=45)
"""How long a request that fails is sent again. One that hangs takes 30 s: it is sent twice."""

_SILENCE = timedelta(seconds=30)  # of a request: between its end, and the bytes of its answer
_SLOWEST = timedelta(minutes=10)
"""For one part of 5 MiB to pass: of three processes with eight each on a line of 2 Mbit/s."""

_CLIENT_OPTIONS = (
    "allow_http",
    "allow_invalid_certificates",
    "connect_timeout",
    "http1_only",
    "http2_only",
    "pool_idle_timeout",
    "pool_max_idle_per_host",
    "proxy_ca_certificate",
    "proxy_excludes",
    "proxy_url",
    "user_agent",
)
"""Of the store's client, which has them from the environment by these names after AWS_."""

_LOOK_SECONDS = 15.0  # between two looks, during a put, at whether the store still answers
_CHECK_SECONDS = 1.0  # between two looks at whether the put is wanted any more
_SILENT_SECONDS = 45.0  # that it may take to: what is asked waits behind parts on a full line


class Storage:
    """Objects by key. Keys are paths with forward slashes; puts are atomic."""

    def __init__(self, url: str) -> None:
        """Open the store at file:///folder (created when missing) or s3://bucket/prefix.

        Raises ValueError for any other address: other stores would differ in what is promised.
        """
        parts = urlsplit(url)
        is_folder = (parts.scheme, parts.netloc) == ("file", "") and url.startswith("file:///")
        if not (is_folder or (parts.scheme == "s3" and parts.netloc)):
            raise ValueError("it is like file:///folder or s3://bucket/prefix")
        if set("?#") & set(url):  # what follows would be left out, and another folder be used
            raise ValueError("write ? and # in it as %3F and %23")
        self._puts = threading.Semaphore(_PUTS)
        self._folder = Path(url2pathname(parts.path)) if is_folder else None
        self._store: ObjectStore = (
            LocalStore(self._folder, mkdir=True, automatic_cleanup=True)
            if self._folder
            else _bucket_at(url, _RETRY, timeout=_SLOWEST, read_timeout=_SILENCE)
        )
        # What is sent counts as silence: puts look themselves whether the store still answers.
        self._sending = self._store if self._folder else _bucket_at(url, _SLOWEST, timeout=_SLOWEST)

    def put(
        self,
        key: str,
        data: bytes | Path,
        headers: Mapping[str, str] | None = None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Store bytes, or a file in parts when it is large. Raises StorageFullError.

        headers: what the answer to a link has, like Content-Type; a folder, without links, keeps
        none. To S3 it takes as long as the line is slow, unless the store falls silent.
        check: asked each second meanwhile; what it raises ends that.
        """
        try:
            with self._puts, _room():
                if self._folder is not None:
                    obstore.put(self._store, key, data, max_concurrency=_PIECES)
                else:
                    asyncio.run(self._put_watched(key, data, dict(headers or {}), check))
        except FileNotFoundError as error:  # a bucket that is gone is a store that is away
            if self._folder is not None:
                raise
            raise GenericError("there is no such bucket") from error

    async def _put_watched(
        self, key: str, data: bytes | Path, headers: dict[str, str], check: Callable[[], None]
    ) -> None:
        named: Any = {"attributes": headers, "max_concurrency": _PIECES}
        putting = asyncio.ensure_future(obstore.put_async(self._sending, key, data, **named))
        watching = asyncio.create_task(self._watch()), asyncio.create_task(_repeat(check))
        done, _ = await asyncio.wait([putting, *watching], return_when=asyncio.FIRST_COMPLETED)
        failures = [task.exception() for task in watching if task in done]
        if putting not in done and failures[0]:
            putting.cancel()
            raise failures[0]
        await putting

    async def _watch(self) -> None:
        """Ask the store for something, again and again. Raises GenericError once it is silent."""
        while True:
            await asyncio.sleep(_LOOK_SECONDS)
            await self.check_within(_SILENT_SECONDS)

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
        with self._bucket(), _room():
            obstore.copy(self._store, key, other)

    def size(self, key: str) -> int:
        """Tell how many bytes an object has. Raises FileNotFoundError."""
        with self._bucket():
            return int(obstore.head(self._store, key)["size"])

    def flush(self, keys: Iterable[str]) -> None:
        """Return once these objects would outlast a power cut. Raises GenericError.

        An S3 store is as far as that when a put returns; a local disk has to be told.
        """
        if self._folder is None:
            return
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

    def get(self, key: str) -> bytes:
        """Read an object's bytes. Raises FileNotFoundError."""
        with self._bucket():
            return bytes(obstore.get(self._store, key).bytes())

    def get_file(self, key: str, path: Path) -> None:
        """Write an object to a file. Raises FileNotFoundError."""
        with path.open("wb") as file:
            for chunk in self.chunks(key):
                file.write(chunk)

    def chunks(self, key: str) -> Iterator[bytes]:
        """Read an object piece by piece. Raises FileNotFoundError at once."""
        with self._bucket():
            found = obstore.get(self._store, key)
        if self._folder is None and found.meta["size"] > _PIECE:
            return self.stream(key, 0, found.meta["size"])
        return (bytes(chunk) for chunk in found.stream(min_chunk_size=_CHUNK))

    def stream(self, key: str, start: int, end: int) -> Iterator[bytes]:
        """Read bytes start…end−1 of an object, in chunks. Raises FileNotFoundError at once.

        From S3 each is a request of its own, and over before it is handed on: a request has a time
        limit, which whoever takes long over what has come, as on a slow line, would run into.
        """
        if start == end:
            return iter(())
        if self._folder is not None:
            found = obstore.get(self._store, key, options={"range": (start, end)})
            return (bytes(chunk) for chunk in found.stream(min_chunk_size=_CHUNK))
        places = range(start, end, _PIECE)
        first = self._piece(key, start, end)
        return itertools.chain([first], (self._piece(key, place, end) for place in places[1:]))

    def _piece(self, key: str, start: int, end: int) -> bytes:
        with self._bucket():
            stop = min(start + _PIECE, end)
            return bytes(obstore.get_range(self._store, key, start=start, end=stop))

    def link(self, key: str, seconds: float) -> str | None:
        """Sign a URL that reads an object without a password, for a time; None for a folder.

        Its answer has the headers that the object was put with.
        Raises GenericError without credentials to sign with.
        """
        if not isinstance(self._store, S3Store):
            return None
        return obstore.sign(self._store, "GET", key, timedelta(seconds=seconds))

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

    def changed(self, prefix: str) -> float:
        """When anything below prefix was last stored, in seconds since 1970; 0 without any.

        In a folder, what is being stored counts too, though it is no object yet.
        """
        if self._folder is not None:
            return _newest(self._folder / prefix)
        found = obstore.list(self._store, prefix=prefix)
        times = (item["last_modified"].timestamp() for batch in found for item in batch)
        return max(times, default=0.0)

    def delete_below(self, prefix: str) -> None:
        """Delete every object below prefix, which ends with a slash; others may do so as well."""
        keys = self.list(prefix)
        if self._folder is None and keys:
            obstore.delete(self._store, keys)
        if self._folder is not None:
            for key in keys:
                self.delete(key)
            # A process that was killed while it stored something has left a file that is no object.
            shutil.rmtree(self._folder / prefix, ignore_errors=True)

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

    def free_bytes(self) -> int | None:
        """Tell how much more fits on the disk, None for S3. Raises GenericError."""
        return None if self._folder is None else _disk(self._folder)[1]

    def disk_bytes(self) -> int | None:
        """Tell how large the disk is, None for S3. Raises GenericError."""
        return None if self._folder is None else _disk(self._folder)[0]

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
    def _bucket(self) -> Iterator[None]:
        """Tell a bucket that is gone, which is a store that is away, from an object that is."""
        try:
            yield
        except FileNotFoundError:
            if self._folder is None:
                self.check()  # without its bucket, this raises GenericError
            raise


async def _repeat(check: Callable[[], None]) -> None:
    while True:
        await asyncio.sleep(_CHECK_SECONDS)
        check()


def _bucket_at(url: str, retry: timedelta, **limits: timedelta) -> ObjectStore:
    """Open a store in S3. retry: how long what fails is sent again. limits: of a request."""
    # One option given, the client would read none of the others from the environment.
    given = {name: os.environ.get(f"AWS_{name.upper()}") for name in _CLIENT_OPTIONS}
    options: Any = {name: value for name, value in given.items() if value is not None}
    return S3Store.from_url(
        url, client_options=options | limits, retry_config={"retry_timeout": retry}
    )


@contextlib.contextmanager
def _room() -> Iterator[None]:
    """Tell a full disk from a store that is away, which the store's client does in words alone."""
    try:
        yield
    except GenericError as error:
        if any(sign in str(error) for sign in _FULL_SIGNS):
            raise StorageFullError(
                "The disk that photographs and results are kept on is full; try again later."
            ) from error
        raise


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
