"""A store that is a bucket of an S3-compatible server."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import timedelta
from pathlib import Path
from typing import Any

import obstore
from obstore.exceptions import GenericError
from obstore.store import S3Store

from service.storage.base import PIECES, Storage, chunks_of, room

_PIECE = 4 * 1024 * 1024  # that a request asks for

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


class BucketStorage(Storage):
    """Objects below the prefix of a bucket."""

    def __init__(self, url: str) -> None:
        """Open the store at s3://bucket/prefix."""
        self._bucket = _bucket_at(url, _RETRY, timeout=_SLOWEST, read_timeout=_SILENCE)
        super().__init__(self._bucket)
        # What is sent counts as silence: puts look themselves whether the store still answers.
        self._sending = _bucket_at(url, _SLOWEST, timeout=_SLOWEST)

    def put(
        self,
        key: str,
        data: bytes | Path,
        headers: Mapping[str, str] | None = None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Store bytes, or a file in parts when it is large. Raises StorageFullError.

        It takes as long as the line is slow, unless the store falls silent. headers, check: as
        for every store.
        """
        try:
            with self._puts, room():
                asyncio.run(self._put_watched(key, data, dict(headers or {}), check))
        except FileNotFoundError as error:  # a bucket that is gone is a store that is away
            raise GenericError("there is no such bucket") from error

    async def _put_watched(
        self, key: str, data: bytes | Path, headers: dict[str, str], check: Callable[[], None]
    ) -> None:
        named: Any = {"attributes": headers, "max_concurrency": PIECES}
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

    def flush(self, keys: Iterable[str]) -> None:
        """Return at once: the store is as far as that when a put returns."""

    def chunks(self, key: str) -> Iterator[bytes]:
        """Read an object piece by piece. Raises FileNotFoundError at once."""
        with self._reading():
            found = obstore.get(self._store, key)
        size = found.meta["size"]
        return self.stream(key, 0, size) if size > _PIECE else chunks_of(found)

    def stream(self, key: str, start: int, end: int) -> Iterator[bytes]:
        """Read bytes start…end−1 of an object, in chunks. Raises FileNotFoundError at once.

        Each is a request of its own, and over before it is handed on: a request has a time limit,
        which whoever takes long over what has come, as on a slow line, would run into.
        """
        if start == end:
            return iter(())
        places = range(start, end, _PIECE)
        first = self._piece(key, start, end)
        return itertools.chain([first], (self._piece(key, place, end) for place in places[1:]))

    def _piece(self, key: str, start: int, end: int) -> bytes:
        with self._reading():
            stop = min(start + _PIECE, end)
            return bytes(obstore.get_range(self._store, key, start=start, end=stop))

    def link(self, key: str, seconds: float) -> str | None:
        """Sign a URL that reads an object without a password, for a time.

        Its answer has the headers that the object was put with.
        Raises GenericError without credentials to sign with.
        """
        return obstore.sign(self._bucket, "GET", key, timedelta(seconds=seconds))

    def changed(self, prefix: str) -> float:
        """When anything below prefix was last stored, in seconds since 1970; 0 without any."""
        found = obstore.list(self._store, prefix=prefix)
        times = (item["last_modified"].timestamp() for batch in found for item in batch)
        return max(times, default=0.0)

    def delete_below(self, prefix: str) -> None:
        """Delete every object below prefix, which ends with a slash; others may do so as well."""
        if keys := self.list(prefix):
            obstore.delete(self._store, keys)

    def free_bytes(self) -> None:
        """Tell none: a bucket has no end."""

    def disk_bytes(self) -> None:
        """Tell none: a bucket has no end."""

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        """Tell a bucket that is gone, which is a store that is away, from an object that is."""
        try:
            yield
        except FileNotFoundError:
            self.check()  # without its bucket, this raises GenericError
            raise


async def _repeat(check: Callable[[], None]) -> None:
    while True:
        await asyncio.sleep(_CHECK_SECONDS)
        check()


def _bucket_at(url: str, retry: timedelta, **limits: timedelta) -> S3Store:
    """Open a store in S3. retry: how long what fails is sent again. limits: of a request."""
    # One option given, the client would read none of the others from the environment.
    given = {name: os.environ.get(f"AWS_{name.upper()}") for name in _CLIENT_OPTIONS}
    options: Any = {name: value for name, value in given.items() if value is not None}
    return S3Store.from_url(
        url, client_options=options | limits, retry_config={"retry_timeout": retry}
    )
