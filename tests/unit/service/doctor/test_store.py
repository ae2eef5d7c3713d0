from __future__ import annotations

import shutil

import pytest
from obstore.exceptions import GenericError

from service import belonging
from service.api.context import Context
from service.doctor.finding import Finding
from service.settings import Settings
from service.storage.base import Storage
from service.storage.folder import FolderStorage
from tests.unit.service.findings import Look


def test_a_store_that_cannot_be_opened_is_told(look: Look, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIGHTLAYERS_STORE_URL", "file:///dev/null/x")
    assert look()["store"].grade == "wrong"


def test_a_store_that_fails_is_told_with_its_cause(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_arguments: object) -> None:
        raise GenericError("status code: 500 Internal Server Error\n\nDebug source")

    monkeypatch.setattr("service.storage.folder.FolderStorage.put", fail)
    found = look()["store"]
    assert (found.grade, found.sentence) == (
        "wrong",
        "it answers and cannot be written (status code: 500 Internal Server Error): allow reading, "
        "writing, listing and deleting, or see what its own log says.",
    )


def test_the_store_is_left_as_it_was(look: Look, context: Context) -> None:
    assert look()["store"].grade == "ok"
    assert context.storage.list("") == []


def test_more_free_space_than_the_disk_has_is_told(
    look: Look, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings.data_dir.mkdir(mode=0o700)
    size = shutil.disk_usage(settings.data_dir).total
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", str(size + 1))
    found = look()["store's disk"]
    assert found.grade == "wrong"
    assert found.sentence.startswith(f"LIGHTLAYERS_FREE_BYTES is {size + 1}, and the store's disk")


def test_a_store_on_no_disk_of_this_machine_has_no_room_to_tell(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", str(2**60))
    monkeypatch.setattr(FolderStorage, "free_bytes", lambda _storage: None)
    found = look()
    assert found["disk"].grade == "ok"
    assert "store's disk" not in found


def test_a_disk_that_does_not_tell_its_free_space_is_told(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_storage: Storage) -> int:
        raise GenericError("the disk does not tell its free space")

    monkeypatch.setattr(FolderStorage, "free_bytes", fail)
    found = look()["store's disk"]
    assert (found.grade, "free space" in found.sentence) == ("wrong", True)


def test_a_store_of_another_database_is_told_with_the_way_out(look: Look, context: Context) -> None:
    assert look()["store's database"] == Finding("ok", "store's database", "it is this one.")
    context.storage.put("database-id", b"another")
    found = look()["store's database"]
    name = belonging.id_of(context.engine)
    assert (found.grade, f"write {name} into its object `database-id`" in found.sentence) == (
        "wrong",
        True,
    )
    context.storage.put("database-id", name.encode())
    assert look()["store's database"].grade == "ok"


@pytest.mark.usefixtures("context")
def test_whose_a_store_is_that_does_not_answer_is_not_told(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def fail(_storage: Storage) -> None:
        asked.append("check")
        raise GenericError("no answer")

    monkeypatch.setattr(Storage, "check", fail)
    assert "store's database" not in look()
    assert asked == ["check"]  # one that hangs takes a minute each time
