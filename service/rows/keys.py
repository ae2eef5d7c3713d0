"""The keys that requests bear: made once, shown once, stored as digests.

A key reads ll_<id>_<secret><checksum>. The id names the key everywhere and owns its jobs, the
secret has 190 random bits, and the checksum tells a key from other text without the database.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import string
import zlib
from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import sqlalchemy as sa

from service.addresses import is_loopback
from service.rows.clock import now
from service.rows.database import may_be_id
from service.rows.tables import keys
from service.settings import Settings

_ALPHABET = string.digits + string.ascii_uppercase + string.ascii_lowercase
_ID_LETTERS, _SECRET_LETTERS, _CHECKSUM_LETTERS = 10, 32, 6
PATTERN = f"ll_([0-9A-Za-z]{{{_ID_LETTERS}}})_[0-9A-Za-z]{{{_SECRET_LETTERS + _CHECKSUM_LETTERS}}}"
"""What a key looks like, for those who search for leaked ones."""

USED_SECONDS = 3600
"""How coarse `used` is."""


class Scope(StrEnum):
    """What a key may be used for."""

    SUBMIT = "submit"  # send photographs, make, cancel and delete jobs
    READ = "read"  # look at jobs and fetch results
    CAPTURE = "capture"  # use cameras
    ADMIN = "admin"  # all of it, with the jobs of every key


@dataclass(frozen=True)
class Quotas:
    """How much a key may ask for; None: as much as the service has."""

    waiting_jobs: int | None = None
    """Jobs that wait at a time."""
    jobs_per_day: int | None = None
    """Jobs made between midnight and midnight, UTC, deleted ones among them."""
    stored_bytes: int | None = None
    """Photographs and results of the key's jobs, and its uploads."""


@dataclass(frozen=True)
class Key:
    """One row; times are seconds since 1970 by the database's clock."""

    id: str
    name: str
    scopes: frozenset[Scope]
    quotas: Quotas
    created: float
    expires: float | None
    revoked: float | None
    used: float | None


_USABLE = sa.and_(
    keys.c.revoked.is_(None), sa.or_(keys.c.expires.is_(None), keys.c.expires > now())
)


def _key(row: sa.Row[Any]) -> Key:
    return Key(
        id=row.id,
        name=row.name,
        scopes=frozenset(map(Scope, row.scopes)),
        quotas=Quotas(row.waiting_jobs, row.jobs_per_day, row.stored_bytes),
        created=row.created,
        expires=row.expires,
        revoked=row.revoked,
        used=row.used,
    )


def create(
    connection: sa.Connection,
    name: str,
    scopes: Collection[Scope],
    quotas: Quotas,
    lifetime_seconds: float | None,
) -> str:
    """Make a key; its text, which nothing can show again."""
    key_id = _letters(_ID_LETTERS)
    body = f"ll_{key_id}_{_letters(_SECRET_LETTERS)}"
    text = body + _checksum(body)
    connection.execute(
        sa.insert(keys).values(
            id=key_id,
            digest=_digest(text),
            name=name,
            scopes=sorted(scopes),
            waiting_jobs=quotas.waiting_jobs,
            jobs_per_day=quotas.jobs_per_day,
            stored_bytes=quotas.stored_bytes,
            created=now(),
            expires=None if lifetime_seconds is None else now() + lifetime_seconds,
        )
    )
    return text


def is_key(text: str) -> bool:
    """Whether a text has the form of a key, its checksum included."""
    return bool(re.fullmatch(PATTERN, text)) and hmac.compare_digest(
        text[-_CHECKSUM_LETTERS:], _checksum(text[:-_CHECKSUM_LETTERS])
    )


def id_of(text: str) -> str:
    """Take the id out of a text with the form of a key."""
    return text[3 : 3 + _ID_LETTERS]


def find(connection: sa.Connection, text: str) -> Key | None:
    """Find the key of this text; None for one that is unknown, revoked or expired."""
    if not is_key(text):
        return None
    query = sa.select(keys).where(keys.c.id == id_of(text), _USABLE)
    row = connection.execute(query).first()
    return _key(row) if row and hmac.compare_digest(row.digest, _digest(text)) else None


def note_use(connection: sa.Connection, key: Key) -> None:
    """Remember that a key was used; to the hour."""
    stale = sa.or_(keys.c.used.is_(None), keys.c.used < now() - USED_SECONDS)
    connection.execute(sa.update(keys).where(keys.c.id == key.id, stale).values(used=now()))


def revoke(connection: sa.Connection, key_id: str) -> bool:
    """Let a key be used no more, from the next request on; false when there is none of this id."""
    if not may_be_id(key_id):
        return False
    revoked = sa.func.coalesce(keys.c.revoked, now())
    this = sa.update(keys).where(keys.c.id == key_id).values(revoked=revoked)
    return connection.execute(this).rowcount == 1


def list_keys(connection: sa.Connection) -> list[Key]:
    """List every key that was ever made, oldest first."""
    rows = connection.execute(sa.select(keys).order_by(keys.c.created, keys.c.id))
    return [_key(row) for row in rows]


def any_made(connection: sa.Connection) -> bool:
    """Whether a key was ever made, even if it was revoked since."""
    return _any(connection)


def is_usable(connection: sa.Connection, key_id: str) -> bool:
    """Whether the key of this id is neither revoked nor expired."""
    return _any(connection, keys.c.id == key_id, _USABLE)


def has_ended(connection: sa.Connection, key_id: str) -> bool:
    """Whether there is a key of this id that is revoked or expired."""
    return _any(connection, keys.c.id == key_id, ~_USABLE)


def any_usable(connection: sa.Connection) -> bool:
    """Whether there is a key that requests can be made with."""
    return _any(connection, _USABLE)


def _any(connection: sa.Connection, *which: sa.ColumnElement[bool]) -> bool:
    query = sa.select(keys.c.id).where(*which).limit(1)
    return connection.execute(query).first() is not None


def required(settings: Settings) -> bool:
    """Whether nobody is served without a key, whatever is in the database."""
    return settings.keys == "required" or not is_loopback(settings.host)


def _letters(number: int) -> str:
    return "".join(secrets.choice(_ALPHABET) for _ in range(number))


def _checksum(text: str) -> str:
    value, letters = zlib.crc32(text.encode()), ""
    for _ in range(_CHECKSUM_LETTERS):
        value, digit = divmod(value, len(_ALPHABET))
        letters = _ALPHABET[digit] + letters
    return letters


def _digest(text: str) -> str:
    # Quick, since a key of 190 random bits is not guessed, however quickly guesses are checked.
    return hashlib.sha256(text.encode()).hexdigest()
