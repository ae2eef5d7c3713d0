from __future__ import annotations

import hashlib
import time
from pathlib import Path

import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

from service import upload_pieces
from service.object_keys import upload_key
from service.rows import tables, uploads
from service.storage.base import Storage
from service.storage.folder import FolderStorage
from tests.unit.service.full_disk import full_disk
from tests.unit.service.upload_rows import added, found


def _append(engine: sa.Engine, storage: Storage, upload: uploads.Upload, data: bytes) -> bool:
    part = upload_pieces.new_name(upload)
    storage.put(upload_key(upload.id, part), data)
    with engine.begin() as connection:
        return uploads.append(connection, upload, part, len(data), 60)


def test_pieces_become_the_file_in_their_order(
    engine: sa.Engine, storage: Storage, tmp_path: Path
) -> None:
    added(engine, "1", 6)
    assert (found(engine, "1").received, found(engine, "1").is_whole) == (0, False)
    for data in (b"ab", b"c", b"def"):
        assert _append(engine, storage, found(engine, "1"), data)
    upload = found(engine, "1")
    assert (upload.received, upload.is_whole, len(upload.parts)) == (6, True, 3)
    digest = upload_pieces.assemble(storage, upload, tmp_path / "file")
    assert (tmp_path / "file").read_bytes() == b"abcdef"
    assert digest == hashlib.sha256(b"abcdef").hexdigest()


def test_what_is_expired_and_what_is_nobodys_goes(engine: sa.Engine, storage: Storage) -> None:
    added(engine, "kept", 6)
    added(engine, "over", 6)
    for name in ("kept", "over"):
        assert _append(engine, storage, found(engine, name), b"abc")
    storage.put("uploads/nobodys/000-x", b"abc")
    storage.put("jobs/1/inputs/flash", b"abc")
    with engine.begin() as connection:
        connection.execute(
            sa.update(tables.uploads).where(tables.uploads.c.id == "over").values(expires=1.0)
        )
    upload_pieces.remove_expired(engine, storage, strays=True)
    upload = found(engine, "kept")
    kept = ["jobs/1/inputs/flash", upload_key(upload.id, upload.parts[0])]
    assert storage.list("") == kept
    with engine.connect() as connection:
        assert uploads.find(connection, "a", "over") is None


def test_pieces_of_another_databases_uploads_stay(engine: sa.Engine, storage: Storage) -> None:
    for name, seconds in (("kept", 60), ("over", -3601)):
        added(engine, name, 6, seconds=seconds)
    for name in ("kept", "over", "anothers"):
        storage.put(f"uploads/{name}/000-x", b"abc")
    upload_pieces.remove_expired(engine, storage, strays=False)
    assert storage.folders("uploads/") == ["anothers", "kept"]
    with engine.connect() as connection:
        assert uploads.find(connection, "a", "over") is None


def test_an_upload_that_is_over_just_now_stays(engine: sa.Engine, storage: Storage) -> None:
    """Or a piece that was taken in at this moment would be added to one whose pieces are gone."""
    added(engine, "1", 6)
    assert _append(engine, storage, found(engine, "1"), b"abc")
    with engine.begin() as connection:
        connection.execute(sa.update(tables.uploads).values(expires=time.time() - 60))
    upload_pieces.remove_expired(engine, storage, strays=True)
    assert found(engine, "1").expired
    assert len(storage.list("uploads/1/")) == 1


def test_on_a_full_disk_pieces_go_where_rows_cannot(engine: sa.Engine, storage: Storage) -> None:
    added(engine, "over", 6, seconds=-3601)
    for name in ("over", "nobodys"):
        storage.put(f"uploads/{name}/000-x", b"abc")
    with full_disk(engine), pytest.raises(sa.exc.OperationalError):
        upload_pieces.remove_expired(engine, storage, strays=True)
    assert storage.list("") == []
    assert found(engine, "over").expired
    upload_pieces.remove_expired(engine, storage, strays=True)
    with engine.connect() as connection:
        assert uploads.find(connection, "a", "over") is None


@pytest.mark.parametrize("strays", [True, False])
def test_pieces_that_cannot_be_deleted_go_with_a_later_sweep(
    strays: bool, engine: sa.Engine, storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the store of another database nothing but their row tells whose they are."""
    for name in ("stuck", "over"):
        added(engine, name, 6, seconds=-3601)
        storage.put(f"uploads/{name}/000-x", b"abc")
    delete = FolderStorage.delete_below

    def refuse(storage: FolderStorage, prefix: str) -> None:
        if "stuck" in prefix:
            raise GenericError("not yours")
        delete(storage, prefix)

    with monkeypatch.context() as patch:
        patch.setattr(FolderStorage, "delete_below", refuse)
        upload_pieces.remove_expired(engine, storage, strays)
    assert storage.folders("uploads/") == ["stuck"]
    assert found(engine, "stuck").expired
    with engine.connect() as connection:
        assert uploads.find(connection, "a", "over") is None
    upload_pieces.remove_expired(engine, storage, strays)
    assert storage.list("") == []
    with engine.connect() as connection:
        assert uploads.find(connection, "a", "stuck") is None


def test_pieces_that_were_half_stored_go_with_their_upload(
    engine: sa.Engine, storage: Storage, tmp_path: Path
) -> None:
    for name, seconds in (("kept", 60), ("over", -3601)):
        added(engine, name, 6, seconds=seconds)
    for name in ("kept", "over", "nobodys"):
        folder = tmp_path / "a store" / "uploads" / name
        folder.mkdir(parents=True)
        (folder / "000-x#1").write_bytes(b"abc")  # no object: its name is one of the store's own
    assert storage.list("") == []
    upload_pieces.remove_expired(engine, storage, strays=True)
    assert [path.name for path in (tmp_path / "a store" / "uploads").iterdir()] == ["kept"]


def test_an_upload_without_its_objects_cannot_be_read(
    engine: sa.Engine, storage: Storage, tmp_path: Path
) -> None:
    added(engine, "1", 3)
    assert _append(engine, storage, found(engine, "1"), b"abc")
    upload_pieces.delete(storage, "1")
    with pytest.raises(FileNotFoundError):
        upload_pieces.assemble(storage, found(engine, "1"), tmp_path / "file")
