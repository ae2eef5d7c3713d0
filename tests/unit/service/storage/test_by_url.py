from __future__ import annotations

from pathlib import Path

import pytest

from service.storage.bucket import BucketStorage
from service.storage.by_url import storage_at
from service.storage.folder import FolderStorage


def test_a_url_of_a_file_is_a_folder_that_is_made(tmp_path: Path) -> None:
    storage = storage_at((tmp_path / "a new store").as_uri())
    assert isinstance(storage, FolderStorage)
    storage.put("a", b"light")
    assert (tmp_path / "a new store" / "a").read_bytes() == b"light"


def test_a_url_of_s3_is_a_bucket() -> None:
    assert isinstance(storage_at("s3://photographs/prefix"), BucketStorage)


@pytest.mark.parametrize("url", ["", "/store", "file:store", "file://host/store", "s3:", "gs://a"])
def test_any_other_address_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="like file:///folder or s3://bucket/prefix"):
        storage_at(url)


@pytest.mark.parametrize("url", ["file:///a?b", "file:///a#b", "s3://a/b?c"])
def test_an_address_of_which_a_part_would_be_left_out_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="%3F and %23"):
        storage_at(url)
