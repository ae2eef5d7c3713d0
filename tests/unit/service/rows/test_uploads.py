from __future__ import annotations

import pytest
import sqlalchemy as sa

from service.rows import uploads
from tests.unit.service.upload_rows import added, found


def _append(engine: sa.Engine, upload: uploads.Upload, part: str, size: int) -> bool:
    with engine.begin() as connection:
        return uploads.append(connection, upload, part, size, 60)


def test_of_two_pieces_for_one_place_one_counts(engine: sa.Engine) -> None:
    before = added(engine, "1", 6)
    assert _append(engine, before, "first", 3)
    assert not _append(engine, before, "second", 3)
    assert (found(engine, "1").received, found(engine, "1").parts) == (3, ["first"])


def test_a_piece_keeps_an_upload_longer_but_not_an_expired_one(engine: sa.Engine) -> None:
    first, second = added(engine, "1", 6, seconds=10), added(engine, "2", 6, seconds=-1)
    assert _append(engine, first, "a", 3)
    assert found(engine, "1").expires > first.expires + 40
    assert second.expired
    assert not _append(engine, second, "b", 3)


def test_it_is_told_when_one_of_several_uploads_is_gone(engine: sa.Engine) -> None:
    added(engine, "1", 6)
    with engine.begin() as connection:
        assert not uploads.remove(connection, "a", ["1", "2"])


def test_an_upload_is_its_owners_alone(engine: sa.Engine) -> None:
    added(engine, "1", 6)
    with engine.begin() as connection:
        assert uploads.find(connection, "b", "1") is None
        assert not uploads.remove(connection, "b", ["1"])
        assert uploads.remove(connection, "a", ["1"])
        assert not uploads.remove(connection, "a", ["1"])


def test_the_rows_of_any_number_of_uploads_are_forgotten(
    engine: sa.Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uploads, "_BATCH", 2)
    for name in ("1", "2", "3", "4", "5"):
        added(engine, name, 6, seconds=-3601)
    added(engine, "kept", 6)
    with engine.begin() as connection:
        over = [each for each, is_over in uploads.long_over(connection).items() if is_over]
        assert sorted(over) == ["1", "2", "3", "4", "5"]
        uploads.forget(connection, over)
        assert uploads.long_over(connection) == {"kept": False}
