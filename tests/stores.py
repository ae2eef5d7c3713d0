"""What a store does, whether it is a folder or S3."""

from __future__ import annotations

import time

import pytest

from service.storage.base import Storage


def check_copy(storage: Storage) -> None:
    """A copy stays when its original goes."""
    storage.put("jobs/6/inputs/flash", b"light")
    storage.copy("jobs/6/inputs/flash", "jobs/7/inputs/flash")
    storage.delete_below("jobs/6/")
    assert storage.get("jobs/7/inputs/flash") == b"light"
    with pytest.raises(FileNotFoundError):
        storage.copy("jobs/6/inputs/flash", "jobs/8/inputs/flash")


def check_folders(storage: Storage) -> None:
    """Folders and their age are told."""
    before = time.time() - 5
    for key in ("listed/1/a/b", "listed/1/c", "listed/2/a", "listed/d"):
        storage.put(key, b"")
    assert storage.folders("listed/") == ["1", "2"]
    assert before < storage.changed("listed/1/") < time.time() + 5
    assert storage.changed("listed/3/") == 0
