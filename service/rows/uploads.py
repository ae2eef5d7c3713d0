"""Uploads that come piece by piece: a row each, and objects in the store that hold the pieces.

Every write of a row names the byte at which it goes on, so that of two pieces for one place, on
whatever hosts, one counts. A row is made before its first object: objects without one are nobody's.
"""

from __future__ import annotations

import hashlib
import logging
import uuid
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from service.object_keys import UPLOADS
from service.rows.clock import now
from service.rows.database import may_be_id
from service.rows.tables import uploads
from service.storage import Storage

MAX_PARTS = 10_000
"""Pieces that one upload may come in."""

_LONG_OVER_SECONDS = 3600.0
"""Longer than any transaction takes, so that none goes on with an upload whose pieces are going."""

ADVICE = "let the service delete what is in its store; the next sweep tries again"

log = logging.getLogger("service.rows.uploads")


@dataclass(frozen=True)
class Upload:
    """One row of service.rows.tables. length, received: bytes. expires: seconds since 1970."""

    id: str
    owner: str
    length: int
    received: int
    parts: list[str]
    metadata: str | None
    expires: float
    expired: bool

    @property
    def is_whole(self) -> bool:
        """Whether all of it has come."""
        return self.received == self.length


def add(connection: sa.Connection, values: dict[str, Any], seconds: float) -> None:
    """Insert an upload of which nothing has come, to be kept for some seconds."""
    connection.execute(sa.insert(uploads).values(parts=[], expires=now() + seconds, **values))


def find(connection: sa.Connection, owner: str, upload_id: str) -> Upload | None:
    """Find an owner's upload of this id, which may be any text."""
    if not may_be_id(upload_id):
        return None
    query = sa.select(uploads, (uploads.c.expires <= now()).label("expired"))
    row = connection.execute(query.where(_one(owner, upload_id))).first()
    return Upload(**row._mapping) if row else None


def part_name(upload: Upload) -> str:
    """Make a name for the object of the next piece, which nobody else makes."""
    return f"{upload.received:015d}-{uuid.uuid4().hex[:16]}"


def part_key(upload: Upload, part: str) -> str:
    """Where a piece lies."""
    return f"{UPLOADS}{upload.id}/{part}"


def append(connection: sa.Connection, upload: Upload, part: str, size: int, seconds: float) -> bool:
    """Add a stored piece of `size` bytes where the upload was read to end, and keep it longer.

    False when it has gone on, has expired or is gone meanwhile.
    """
    here = sa.and_(
        _one(upload.owner, upload.id),
        uploads.c.received == upload.received,
        uploads.c.expires > now(),
    )
    grown = connection.execute(
        sa.update(uploads)
        .where(here)
        .values(
            received=upload.received + size,
            parts=[*upload.parts, part],
            expires=now() + seconds,
        )
    )
    return grown.rowcount == 1


def remove(connection: sa.Connection, owner: str, upload_ids: Collection[str]) -> bool:
    """Delete an owner's uploads; false when one of them is not there (any more).

    upload_ids: any texts.
    """
    if not all(map(may_be_id, upload_ids)):
        return False
    gone = connection.execute(
        sa.delete(uploads).where(uploads.c.owner == owner, uploads.c.id.in_(upload_ids))
    )
    return gone.rowcount == len(set(upload_ids))


def delete_parts(storage: Storage, upload_id: str) -> None:
    """Delete the pieces of an upload that has no row any more."""
    storage.delete_below(f"{UPLOADS}{upload_id}/")


def assemble(storage: Storage, upload: Upload, path: Path) -> str:
    """Write a whole upload to a file; its SHA-256. Raises FileNotFoundError."""
    digest = hashlib.sha256()
    with path.open("wb") as file:
        for part in upload.parts:
            for chunk in storage.chunks(part_key(upload, part)):
                digest.update(chunk)
                file.write(chunk)
    return digest.hexdigest()


def remove_expired(engine: sa.Engine, storage: Storage, strays: bool) -> None:
    """Delete uploads whose time is long over. May run at any time.

    strays: also delete pieces without an upload, which in another database's store are its own.
    Pieces go first, since on a full disk no row can. Those that cannot be deleted stay, with their
    row.
    """
    # In this order: what has a piece now, if a half-stored one, had its row before.
    stored = set(storage.folders(UPLOADS))
    with engine.connect() as connection:
        moment = connection.execute(sa.select(now() - _LONG_OVER_SECONDS)).scalar_one()
        over = uploads.c.expires <= moment  # the same ones each time
        found = connection.execute(sa.select(uploads.c.id, over.label("over")))
        is_over: dict[str, bool] = {row.id: row.over for row in found}
    stuck = []
    for upload_id in sorted(each for each in stored if is_over.get(each, strays)):
        if not storage.try_delete_below(f"{UPLOADS}{upload_id}/"):
            log.warning("the pieces of upload %s cannot be deleted: %s", upload_id, ADVICE)
            stuck.append(upload_id)
    # Nothing else tells whose the pieces are where another database's lie beside them.
    with engine.begin() as connection:
        connection.execute(sa.delete(uploads).where(over, uploads.c.id.not_in(stuck)))


def _one(owner: str, upload_id: str) -> sa.ColumnElement[bool]:
    return sa.and_(uploads.c.id == upload_id, uploads.c.owner == owner)
