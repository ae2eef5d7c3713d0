from __future__ import annotations

import re
from typing import Literal

import pytest
import sqlalchemy as sa

from service.rows import keys, tables
from service.rows.keys import Quotas, Scope
from service.settings import Settings


def _make(connection: sa.Connection, lifetime_seconds: float | None = None) -> str:
    quotas = Quotas(waiting_jobs=2, stored_bytes=10**12)
    return keys.create(connection, "phone", {Scope.SUBMIT, Scope.READ}, quotas, lifetime_seconds)


def _flipped(text: str, place: int) -> str:
    return text[:place] + ("a" if text[place] != "a" else "b") + text[place + 1 :]


def test_a_key_is_found_with_all_that_it_was_made_with(connection: sa.Connection) -> None:
    text = _make(connection)
    found = keys.find(connection, text)
    assert found is not None
    assert (found.id, found.name) == (text[3:13], "phone")
    assert found.scopes == {Scope.SUBMIT, Scope.READ}
    assert found.quotas == Quotas(2, None, 10**12)
    assert (found.expires, found.revoked, found.used) == (None, None, None)


def test_the_database_has_a_digest_and_no_key(connection: sa.Connection) -> None:
    text = _make(connection)
    row = connection.execute(sa.select(tables.keys)).one()
    assert re.fullmatch("[0-9a-f]{64}", row.digest)
    assert text[14:] not in repr(row)


def test_no_two_keys_are_alike_and_all_have_the_form(connection: sa.Connection) -> None:
    made = [_make(connection) for _ in range(20)]
    assert len(set(made)) == len({keys.id_of(text) for text in made}) == 20
    assert all(re.fullmatch(keys.PATTERN, text) and keys.is_key(text) for text in made)


@pytest.mark.parametrize("place", [3, 12, 14, 30, 45, 46, 51])
def test_one_wrong_letter_is_told_without_the_database(
    place: int, connection: sa.Connection
) -> None:
    text = _flipped(_make(connection), place)
    assert re.fullmatch(keys.PATTERN, text)
    assert not keys.is_key(text)
    assert keys.find(connection, text) is None


@pytest.mark.parametrize("text", ["", "ll_", "ll_%_%", "' OR 1=1 --", "ll_" + "a" * 49, "é" * 52])
def test_what_is_no_key_is_not_found(text: str, connection: sa.Connection) -> None:
    _make(connection)
    assert not keys.is_key(text)
    assert keys.find(connection, text) is None


def test_a_key_of_another_database_is_not_found(connection: sa.Connection) -> None:
    text = _make(connection)
    other = _make(connection)
    connection.execute(sa.delete(tables.keys).where(tables.keys.c.id == keys.id_of(text)))
    assert keys.is_key(text) and keys.find(connection, text) is None
    # nor one that has the id of a known key, a good checksum and another secret
    connection.execute(
        sa.update(tables.keys)
        .where(tables.keys.c.id == keys.id_of(other))
        .values(id=keys.id_of(text))
    )
    assert keys.find(connection, text) is None


def test_a_revoked_key_is_not_found_and_stays_revoked(connection: sa.Connection) -> None:
    text = _make(connection)
    assert keys.revoke(connection, keys.id_of(text))
    assert keys.find(connection, text) is None
    (first,) = keys.list_keys(connection)
    assert keys.revoke(connection, keys.id_of(text))
    assert keys.list_keys(connection) == [first] and first.revoked is not None
    assert not keys.revoke(connection, "nothing")


def test_an_expired_key_is_not_found(connection: sa.Connection) -> None:
    assert keys.find(connection, _make(connection, lifetime_seconds=-1)) is None
    assert keys.find(connection, _make(connection, lifetime_seconds=60)) is not None


def test_whether_there_is_a_key(connection: sa.Connection) -> None:
    assert (keys.any_made(connection), keys.any_usable(connection)) == (False, False)
    _make(connection, lifetime_seconds=-1)
    assert (keys.any_made(connection), keys.any_usable(connection)) == (True, False)
    text = _make(connection)
    assert keys.any_usable(connection)
    keys.revoke(connection, keys.id_of(text))
    assert (keys.any_made(connection), keys.any_usable(connection)) == (True, False)


def test_a_key_has_ended_that_is_revoked_or_expired(connection: sa.Connection) -> None:
    good, expired, revoked = (
        keys.id_of(_make(connection, lifetime_seconds=seconds)) for seconds in (60, -1, 60)
    )
    keys.revoke(connection, revoked)
    ended = [keys.has_ended(connection, one) for one in (good, expired, revoked, "", "unknown")]
    assert ended == [False, True, True, False, False]


def test_use_is_noted_to_the_hour(connection: sa.Connection) -> None:
    key = keys.find(connection, _make(connection))
    assert key is not None
    keys.note_use(connection, key)
    (first,) = keys.list_keys(connection)
    keys.note_use(connection, key)
    assert keys.list_keys(connection) == [first] and first.used is not None
    connection.execute(sa.update(tables.keys).values(used=first.used - keys.USED_SECONDS - 1))
    keys.note_use(connection, key)
    assert (keys.list_keys(connection)[0].used or 0) >= first.used


@pytest.mark.parametrize(
    ("host", "asked", "expected"),
    [
        ("127.0.0.1", "loopback", False),
        ("::1", "loopback", False),
        ("127.0.0.1", "required", True),
        ("0.0.0.0", "loopback", True),
        ("192.168.1.7", "required", True),
    ],
)
def test_keys_are_required_where_others_can_ask(
    host: str, asked: Literal["loopback", "required"], expected: bool
) -> None:
    assert keys.required(Settings(host=host, keys=asked)) is expected
