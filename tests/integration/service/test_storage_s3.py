from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest
from obstore.exceptions import BaseError

from service.errors import StartError
from service.opening import open_storage
from service.patience import passes
from service.settings import Settings
from service.storage.base import Storage
from service.storage.by_url import storage_at
from tests.stores import check_copy, check_folders


@pytest.fixture
def storage(s3: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> Storage:
    for name, value in s3.items():
        monkeypatch.setenv(name, value)
    return storage_at("s3://photographs/some/prefix")


def test_objects_live_below_the_prefix(storage: Storage) -> None:
    storage.put("jobs/1/inputs/flash", b"light")
    assert storage.get("jobs/1/inputs/flash") == b"light"
    assert storage.list("jobs/1/") == ["jobs/1/inputs/flash"]
    assert storage_at("s3://photographs").list("some/prefix/jobs/1") == [
        "some/prefix/jobs/1/inputs/flash"
    ]


def test_a_large_file_is_stored_whole(storage: Storage, tmp_path: Path) -> None:
    data = bytes(range(251)) * 60_000  # more than one part of an upload
    (tmp_path / "photograph").write_bytes(data)
    digest = storage.put_file("jobs/2/inputs/flash", tmp_path / "photograph")
    assert digest == hashlib.sha256(data).hexdigest()
    storage.get_file("jobs/2/inputs/flash", tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == data
    part = b"".join(storage.stream("jobs/2/inputs/flash", 10_000_000, 10_000_500))
    assert part == data[10_000_000:10_000_500]


def test_no_request_lasts_as_long_as_its_reader(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each piece is one of its own, of which nothing is left to come when it is handed on."""
    monkeypatch.setattr("service.storage.bucket._PIECE", 4)
    storage.put("jobs/2/a", b"0123456789")
    storage.put("jobs/2/empty", b"")
    assert list(storage.chunks("jobs/2/a")) == [b"0123", b"4567", b"89"]
    storage.put("jobs/2/small", b"0123")
    small = [list(storage.chunks(f"jobs/2/{name}")) for name in ("small", "empty")]
    assert small == [[b"0123"], []]
    pieces = storage.stream("jobs/2/a", 1, 10)
    assert [next(pieces), next(pieces)] == [b"1234", b"5678"]
    storage.delete("jobs/2/a")
    with pytest.raises(FileNotFoundError):
        next(pieces)


def test_only_what_lies_below_is_deleted(storage: Storage) -> None:
    for key in ("jobs/3/1/a", "jobs/3/1/b", "jobs/3/10/a"):
        storage.put(key, b"")
    storage.delete_below("jobs/3/1/")
    assert storage.list("jobs/3/") == ["jobs/3/10/a"]


def test_what_is_not_there_is_said(storage: Storage) -> None:
    with pytest.raises(FileNotFoundError):
        storage.get("jobs/4/nothing")
    with pytest.raises(FileNotFoundError):
        storage.stream("jobs/4/nothing", 0, 1)


@pytest.mark.usefixtures("storage")
def test_a_bucket_that_is_gone_is_a_store_that_is_away() -> None:
    with pytest.raises(BaseError, match="no such bucket") as caught:
        storage_at("s3://gone").put("jobs/5/inputs/flash", b"light")
    assert passes(caught.value)


@pytest.mark.usefixtures("storage")
@pytest.mark.parametrize(
    "work",
    [
        lambda gone, _: gone.get("jobs/5/inputs/flash"),
        lambda gone, path: gone.get_file("jobs/5/inputs/flash", path),
        lambda gone, _: gone.stream("jobs/5/inputs/flash", 0, 1),
        lambda gone, _: gone.size("jobs/5/inputs/flash"),
        lambda gone, _: gone.copy("jobs/5/inputs/flash", "jobs/6/inputs/flash"),
    ],
    ids=["get", "get_file", "stream", "size", "copy"],
)
def test_of_a_bucket_that_is_gone_no_object_is_missing(
    work: Callable[[Storage, Path], object], tmp_path: Path
) -> None:
    with pytest.raises(BaseError) as caught:
        work(storage_at("s3://gone"), tmp_path / "flash")
    assert passes(caught.value)


def test_a_copy_stays_when_its_original_goes(storage: Storage) -> None:
    check_copy(storage)


def test_folders_and_their_age_are_told(storage: Storage) -> None:
    check_folders(storage)


def test_a_store_that_answers_passes_its_check(storage: Storage) -> None:
    storage.check()


def test_a_bucket_has_no_end(storage: Storage) -> None:
    assert storage.free_bytes() is None


def test_what_is_put_outlasts_a_power_cut(storage: Storage) -> None:
    storage.put("jobs/5/inputs/flash", b"light")
    storage.flush(["jobs/5/inputs/flash"])
    assert storage.get("jobs/5/inputs/flash") == b"light"


@pytest.mark.usefixtures("storage")
def test_a_bucket_that_is_not_there_does_not() -> None:
    with pytest.raises(Exception, match="NoSuchBucket"):
        storage_at("s3://nowhere").check()


def test_a_signed_url_gives_the_object_to_who_has_it(storage: Storage) -> None:
    storage.put("jobs/6/1/lamp 1.jpg", b"light")
    link = storage.link("jobs/6/1/lamp 1.jpg", 60)
    assert link is not None
    assert "X-Amz-Expires=60" in link
    assert httpx.get(link, headers={"range": "bytes=1-2"}, timeout=60).content == b"ig"


@pytest.mark.parametrize("size", [5, 12_000_000], ids=["whole", "in parts"])
def test_a_signed_url_answers_with_the_headers_of_the_object(
    size: int, storage: Storage, tmp_path: Path
) -> None:
    (tmp_path / "lamp1.jpg").write_bytes(bytes(size))
    headers = {"Content-Type": "image/jpeg", "Content-Disposition": 'inline; filename="lamp1.jpg"'}
    storage.put_file("jobs/6/1/lamp1.jpg", tmp_path / "lamp1.jpg", headers)
    link = storage.link("jobs/6/1/lamp1.jpg", 60)
    assert link is not None
    answer = httpx.get(link, timeout=60)
    assert (answer.status_code, len(answer.content)) == (200, size)
    assert headers.items() <= {name.title(): text for name, text in answer.headers.items()}.items()


def test_a_copy_has_the_headers_of_the_object(storage: Storage) -> None:
    headers = {"Content-Type": "image/x-exr", "Content-Disposition": 'inline; filename="a.exr"'}
    storage.put("jobs/6/1/a.exr", b"light", headers)
    storage.copy("jobs/6/1/a.exr", "jobs/7/1/a.exr")
    link = storage.link("jobs/7/1/a.exr", 60)
    assert link is not None
    answer = httpx.get(link, timeout=60).raise_for_status()
    assert headers.items() <= {name.title(): text for name, text in answer.headers.items()}.items()


def test_without_credentials_nothing_is_signed(
    storage: Storage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert storage.link("jobs/6/1/a", 60) is not None
    assert storage_at(tmp_path.as_uri()).link("jobs/6/1/a", 60) is None
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    monkeypatch.setenv("AWS_SKIP_SIGNATURE", "true")
    # where credentials of a cloud's machine would come from
    monkeypatch.setenv("AWS_METADATA_ENDPOINT", "http://127.0.0.1:1")
    settings = Settings(
        data_dir=tmp_path, store_url="s3://photographs/some/prefix", store_presign=True
    )
    with pytest.raises(StartError, match="LIGHTLAYERS_STORE_PRESIGN"):
        open_storage(settings)
