"""The rows of uploads, which come piece by piece; service.upload_pieces has the pieces.

Every write of a row names the byte at which it goes on, so that of two pieces for one place, on
whatever hosts, one counts.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from service.rows.clock import now
from service.rows.database import may_be_id
from service.rows.tables import uploads

MAX_PARTS = 10_000
"""Pieces that one upload may come in."""

_LONG_OVER_SECONDS = 3600.0
"""Longer than any transaction takes, so that none goes on with an upload whose pieces are going."""

_BATCH = 500  # ids in a statement


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


def long_over(connection: sa.Connection) -> dict[str, bool]:
    """Tell by id of every upload whether its time is over, and no transaction goes on with it."""
    over = uploads.c.expires <= now() - _LONG_OVER_SECONDS
    found = connection.execute(sa.select(uploads.c.id, over.label("over")))
    return {row.id: row.over for row in found}


def forget(connection: sa.Connection, upload_ids: Sequence[str]) -> None:
    """Delete the rows of uploads whose pieces are gone."""
    for start in range(0, len(upload_ids), _BATCH):
        some = uploads.c.id.in_(upload_ids[start : start + _BATCH])
        connection.execute(sa.delete(uploads).where(some))


def _one(owner: str, upload_id: str) -> sa.ColumnElement[bool]:
    return sa.and_(uploads.c.id == upload_id, uploads.c.owner == owner)
