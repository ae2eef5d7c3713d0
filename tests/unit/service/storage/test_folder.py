from __future__ import annotations

import errno
import hashlib
import os
import shutil
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import obstore
import pytest
from obstore.exceptions import GenericError

from service.errors import StorageFullError
from service.storage.base import Storage
from service.storage.by_url import storage_at
from tests.stores import check_copy, check_folders
from tests.unit.service.at_first import raising


def test_bytes_come_back(storage: Storage) -> None:
    storage.put("jobs/1/inputs/flash", b"light")
    assert storage.get("jobs/1/inputs/flash") == b"light"


def test_a_file_is_stored_with_its_digest(storage: Storage, tmp_path: Path) -> None:
    data = bytes(range(256)) * 20_000
    (tmp_path / "photograph").write_bytes(data)
    assert storage.put_file("jobs/1/inputs/flash", tmp_path / "photograph") == (
        hashlib.sha256(data).hexdigest()
    )
    storage.get_file("jobs/1/inputs/flash", tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == data


def test_a_flushed_object_and_the_folders_that_name_it_are_synchronized(
    storage: Storage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[Path] = []
    monkeypatch.setattr(
        os, "fsync", lambda file: found.append(Path(f"/proc/self/fd/{file}").readlink())
    )
    for key in ("jobs/1/inputs/flash", "jobs/1/inputs/no_flash", "jobs/2/inputs/flash"):
        storage.put(key, b"light")
    storage.flush(["jobs/1/inputs/flash", "jobs/1/inputs/no_flash"])
    root = tmp_path / "a store"
    jobs = root / "jobs"
    inputs = jobs / "1" / "inputs"
    expected = [root, jobs, jobs / "1", inputs, inputs / "flash", inputs / "no_flash"]
    assert sorted(found) == expected


def test_an_object_that_is_gone_cannot_be_flushed(storage: Storage) -> None:
    with pytest.raises(GenericError):
        storage.flush(["jobs/1/inputs/flash"])


def test_a_part_can_be_read(storage: Storage) -> None:
    storage.put("a", b"0123456789")
    assert b"".join(storage.stream("a", 2, 5)) == b"234"
    assert b"".join(storage.stream("a", 0, 10)) == b"0123456789"
    assert b"".join(storage.stream("a", 4, 4)) == b""


def test_what_is_not_there_is_said_at_once(storage: Storage, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        storage.get("a")
    with pytest.raises(FileNotFoundError):
        storage.stream("a", 0, 1)
    with pytest.raises(FileNotFoundError):
        storage.get_file("a", tmp_path / "copy")


def test_only_what_lies_below_is_deleted(storage: Storage) -> None:
    for key in ("jobs/1/1/a", "jobs/1/1/b/c", "jobs/1/10/a", "jobs/11/1/a"):
        storage.put(key, b"")
    storage.delete_below("jobs/1/1/")
    assert storage.list("") == ["jobs/1/10/a", "jobs/11/1/a"]
    storage.delete_below("jobs/1/")
    assert storage.list("") == ["jobs/11/1/a"]
    storage.delete_below("jobs/nothing/")
    assert storage.list("jobs") == ["jobs/11/1/a"]


def test_the_disk_of_a_folder_has_so_much_free(
    storage: Storage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Path] = []

    def disk_usage(path: Path) -> SimpleNamespace:
        asked.append(path)
        return SimpleNamespace(total=100, used=60, free=35)

    monkeypatch.setattr(shutil, "disk_usage", disk_usage)
    assert storage.free_bytes() == 35
    assert asked == [tmp_path / "a store"]


def test_a_folder_that_is_gone_has_no_free_space(storage: Storage, tmp_path: Path) -> None:
    (tmp_path / "a store").rmdir()
    with pytest.raises(GenericError):
        storage.free_bytes()


def test_a_copy_stays_when_its_original_goes(storage: Storage) -> None:
    check_copy(storage)


def test_folders_and_their_age_are_told(storage: Storage) -> None:
    check_folders(storage)


def test_a_healthy_store_passes_its_check(storage: Storage) -> None:
    storage.check()


def test_a_store_whose_folder_is_gone_does_not(storage: Storage, tmp_path: Path) -> None:
    (tmp_path / "a store").rmdir()
    (tmp_path / "a store").write_bytes(b"a file")
    with pytest.raises(Exception, match="a store"):
        storage.check()


def test_what_a_killed_put_has_left_goes_too(tmp_path: Path) -> None:
    storage = storage_at(tmp_path.as_uri())
    storage.put("jobs/a/1/lamp1.tif", b"whole")
    storage.put("jobs/b/1/lamp1.tif", b"another's")
    (tmp_path / "jobs/a/1/lamp2.tif#1").write_bytes(b"half")
    assert storage.list("jobs/a/") == ["jobs/a/1/lamp1.tif"]
    storage.delete_below("jobs/a/")
    assert not (tmp_path / "jobs/a").exists()
    assert storage.get("jobs/b/1/lamp1.tif") == b"another's"


def test_a_few_puts_go_at_a_time(storage: Storage, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each holds pieces of a file in memory."""
    going, most = [0], [0]
    lock, four = threading.Lock(), threading.Barrier(4, timeout=60)

    def put(*_arguments: object, **_named: object) -> None:
        with lock:
            going[0] += 1
            most[0] = max(most[0], going[0])
        four.wait()  # each one waits for three others
        with lock:
            going[0] -= 1

    monkeypatch.setattr(obstore, "put", put)
    with ThreadPoolExecutor(16) as pool:
        list(pool.map(lambda number: storage.put(f"{number}", b""), range(16)))
    assert most[0] == 4


def test_what_several_delete_at_once_is_deleted_and_no_error(
    storage: Storage, tmp_path: Path
) -> None:
    for job in range(50):
        for name in ("inputs/flash", "1/layers.exr", "1/gamma.png"):
            storage.put(f"jobs/{job}/{name}", b"light")

    def delete(_number: int) -> None:
        for job in range(50):
            storage.delete_below(f"jobs/{job}/")

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(delete, range(4)))
    assert storage.list("jobs/") == []
    assert list((tmp_path / "a store").glob("jobs/*")) == []


def test_an_object_that_is_gone_is_deleted(storage: Storage) -> None:
    storage.delete("jobs/1/inputs/flash")
    assert storage.list("jobs/") == []


@pytest.mark.parametrize(
    "words",
    [
        *(
            f"LocalFileSystem error: Unable to copy data to file: {os.strerror(number)} "
            f"(os error {number})"
            for number in (errno.ENOSPC, errno.EDQUOT)
        ),
        "S3 error: Error performing PUT http://store/photographs/a in 3.3s, after 10 retries, "
        "max_retries: 10, retry_timeout: 45s  - Server returned non-2xx status code: 507 "
        "Insufficient Storage: XMinioStorageFull",
    ],
)
def test_a_full_disk_is_told_from_a_store_that_is_away(
    storage: Storage, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the words of the store's client."""

    def fail(*_arguments: object, **_named: object) -> None:
        raise GenericError(f"Generic {words}\n\nDebug source:\nGeneric {{}}")

    for name in ("put", "copy"):
        monkeypatch.setattr(obstore, name, fail)
    for store in (partial(storage.put, "a", b"light"), partial(storage.copy, "a", "b")):
        with pytest.raises(StorageFullError, match="kept on is full"):
            store()


def test_a_store_that_is_away_is_not_full(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    away = GenericError("Generic S3 error: connection refused (os error 111)")
    monkeypatch.setattr(obstore, "put", raising(away))
    with pytest.raises(GenericError):
        storage.put("a", b"light")
