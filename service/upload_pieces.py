"""The objects in the store that hold the pieces of uploads, whose rows are service.rows.uploads.

A row is made before its first object: objects without one are nobody's.
"""

from __future__ import annotations

import hashlib
import logging
import uuid
from pathlib import Path

import sqlalchemy as sa

from service.object_keys import UPLOADS, upload_key
from service.rows import uploads
from service.rows.uploads import Upload
from service.storage.base import Storage

ADVICE = "let the service delete what is in its store; the next sweep tries again"

log = logging.getLogger("service.upload_pieces")


def new_name(upload: Upload) -> str:
    """Make a name for the object of the next piece, which nobody else makes."""
    return f"{upload.received:015d}-{uuid.uuid4().hex[:16]}"


def delete(storage: Storage, upload_id: str) -> None:
    """Delete the pieces of an upload that has no row any more."""
    storage.delete_below(upload_key(upload_id))


def assemble(storage: Storage, upload: Upload, path: Path) -> str:
    """Write a whole upload to a file; its SHA-256. Raises FileNotFoundError."""
    digest = hashlib.sha256()
    with path.open("wb") as file:
        for part in upload.parts:
            for chunk in storage.chunks(upload_key(upload.id, part)):
                digest.update(chunk)
                file.write(chunk)
    return digest.hexdigest()


def remove_expired(engine: sa.Engine, storage: Storage, strays: bool) -> None:
    """Delete uploads whose time is long over. May run at any time.

    strays: also delete pieces without an upload, which in another database's store are its own.
    Pieces go first, since on a full disk no row can. Those that cannot be deleted stay, with their
    row: where another database's lie beside them, nothing else tells whose they are.
    """
    # In this order: what has a piece now, if a half-stored one, had its row before.
    stored = set(storage.folders(UPLOADS))
    with engine.connect() as connection:
        is_over = uploads.long_over(connection)
    stuck = set()
    for upload_id in sorted(each for each in stored if is_over.get(each, strays)):
        if not storage.try_delete_below(upload_key(upload_id)):
            log.warning("the pieces of upload %s cannot be deleted: %s", upload_id, ADVICE)
            stuck.add(upload_id)
    with engine.begin() as connection:
        gone = [each for each, over in is_over.items() if over and each not in stuck]
        uploads.forget(connection, gone)
