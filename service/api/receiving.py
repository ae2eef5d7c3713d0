"""Takes the body of a request into an upload, piece by piece."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from fastapi import Request
from fastapi.concurrency import contextmanager_in_threadpool
from obstore.exceptions import BaseError
from starlette.requests import ClientDisconnect

from service import upload_pieces
from service.api.context import Context
from service.errors import (
    ChecksumError,
    MalformedRequestError,
    OffsetError,
    SlowRequestError,
    UploadTooLargeError,
)
from service.object_keys import upload_key
from service.rows import uploads
from service.rows.uploads import Upload
from service.workers import scratch

_PART_BYTES = 8 * 1024 * 1024
"""Bytes after which what has come is kept, whatever happens to the rest."""

ALGORITHMS = ("sha256", "sha1")
"""Of checksums, the better one first."""

_ELSEWHERE = (
    "The upload was gone on with by another request, or ended, meanwhile; ask with HEAD where it "
    "goes on."
)


@dataclass(frozen=True)
class Checksum:
    """What the body of a request must give; algorithm: one of ALGORITHMS."""

    algorithm: str
    digest: bytes


async def receive(
    request: Request, context: Context, upload: Upload, checksum: Checksum | None
) -> Upload:
    """Append the request's body to an upload; the upload as it is then.

    Without a checksum what has come is kept even where the connection breaks or stalls; with one
    nothing is, unless all has come and fits. Raises UploadTooLargeError, ChecksumError, OffsetError
    where another request has gone on with the upload meanwhile, MalformedRequestError after too
    many pieces, ClientDisconnect, SlowRequestError.
    """
    data_dir = context.settings.data_dir
    async with contextmanager_in_threadpool(scratch.folder(data_dir)) as directory:
        body = _Body(context, upload, directory / "part", checksum)
        try:
            async for chunk in request.stream():
                await context.store(body.write, chunk)
        except (ClientDisconnect, SlowRequestError):
            if checksum is None:
                await context.store(body.keep)
            raise
        await context.store(body.end)
        return body.upload


class _Body:
    def __init__(
        self, context: Context, upload: Upload, path: Path, checksum: Checksum | None
    ) -> None:
        self.upload = upload
        self._context = context
        self._path = path
        self._checksum = checksum
        self._digest = hashlib.new(checksum.algorithm) if checksum else None
        self._size = 0

    def write(self, chunk: bytes) -> None:
        """Take what came next."""
        self._size += len(chunk)
        if self.upload.received + self._size > self.upload.length:
            raise UploadTooLargeError(
                f"The upload has {self.upload.length:,} bytes by its Upload-Length; more came."
            )
        with self._path.open("ab") as file:
            file.write(chunk)
        if self._digest:
            self._digest.update(chunk)
        elif self._size >= _PART_BYTES:
            self.keep()

    def end(self) -> None:
        """Keep the last of it, once all has come and fits its checksum."""
        if self._digest and self._checksum and self._digest.digest() != self._checksum.digest:
            raise ChecksumError(
                "The bytes that came do not have the checksum of Upload-Checksum; send them again."
            )
        self.keep()

    def keep(self) -> None:
        """Store what came since the last time, and say so in the row."""
        if self._size == 0:
            return
        upload, context = self.upload, self._context
        if len(upload.parts) >= uploads.MAX_PARTS:
            raise MalformedRequestError(
                f"The upload came in {uploads.MAX_PARTS:,} pieces; send another in larger ones."
            )
        part = upload_pieces.new_name(upload)
        key = upload_key(upload.id, part)
        self._store(key)
        with context.engine.begin() as connection:
            kept = uploads.append(
                connection, upload, part, self._size, context.settings.upload_seconds
            )
            now = uploads.find(connection, upload.owner, upload.id) if kept else None
        if now is None:
            context.storage.delete(key)
            raise OffsetError(_ELSEWHERE)
        self.upload = now
        self._path.unlink()
        self._size = 0

    def _store(self, key: str) -> None:
        upload, context = self.upload, self._context
        try:
            context.storage.put(key, self._path)
            context.storage.flush([key])
        except BaseError as error:
            with context.engine.connect() as connection:
                ended = uploads.find(connection, upload.owner, upload.id) is None
            if ended:  # and its folder with it, while this was stored
                raise OffsetError(_ELSEWHERE) from error
            raise
