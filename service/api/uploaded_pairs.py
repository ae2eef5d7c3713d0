"""What whole uploads are to requests for jobs that name them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import sqlalchemy as sa

from pipeline.errors import OptionError
from service import upload_pieces
from service.api.callers import Caller
from service.api.context import Context
from service.errors import UnfinishedUploadError
from service.rows import uploads
from service.rows.uploads import Upload


def bring_uploaded(
    context: Context, caller: Caller, named: dict[str, str], directory: Path
) -> dict[str, str]:
    """Write uploads to files of a directory; their SHA-256.

    named: ids by frame; the files bear the frames' names. Raises OptionError for what is no upload
    of the caller's, UnfinishedUploadError.
    """
    with context.engine.connect() as connection:
        found = {frame: _find(connection, caller, frame, named[frame]) for frame in named}
    try:
        return {
            frame: upload_pieces.assemble(context.storage, upload, directory / frame)
            for frame, upload in found.items()
        }
    except FileNotFoundError as error:  # another request has used it just now
        raise OptionError(_UNKNOWN.format("uploads", "of these ids")) from error


def take_over(connection: sa.Connection, caller: Caller, named: Mapping[str, str]) -> None:
    """Delete the rows of uploads that become a job in this transaction. Raises OptionError."""
    if named and not uploads.remove(connection, caller.owner, set(named.values())):
        raise OptionError(_UNKNOWN.format("uploads", "of these ids"))


_UNKNOWN = "{}: there is no upload {}; it may have expired, or a job may have used it."


def _find(connection: sa.Connection, caller: Caller, frame: str, upload_id: str) -> Upload:
    upload = uploads.find(connection, caller.owner, upload_id)
    if upload is None or upload.expired:
        raise OptionError(_UNKNOWN.format(f"uploads.{frame}", f"{upload_id[:32]!r}"))
    if not upload.is_whole:
        raise UnfinishedUploadError(
            f"uploads.{frame}: {upload.received:,} of {upload.length:,} bytes have come; "
            "send the rest first."
        )
    return upload
